"""The bridge to ROS 2, received through a Zenoh router and decoded by rosbags."""

import os
import signal
import socket
import time
from struct import Struct
from types import SimpleNamespace

import numpy as np
import pytest

import runtime
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.recording.newest_row import NewestRow
from runtime.record.recorder.ros2_bridge import IDLE_PERIOD, LOOK_PERIOD, Bridge
from tests.runtime.ros2 import DIAGNOSTICS, IMU, JOINT_STATE, router
from tests.runtime.runs import descendant, started, write

DIAGRAM = """
from blocks.actuators import CubeMars
from blocks.imus import MicroStrain
from blocks.models import Limb
from blocks.recorders import CsvRecorder
from blocks.sinks import Ros2
from blocks.sources import Sine
from graph import Diagram, subsystem

with Diagram("exo", rate=200) as diagram:
    with subsystem("left"):
        for number, joint in enumerate(("hip", "knee"), 1):
            CubeMars("AK80-9", bus="legs", can_id=number, name=joint)(torque_command=Sine(amplitude=1.0)())
        MicroStrain("1", channels=("accel", "gyro", "quaternion"), name="thigh_imu")
    Ros2(router="PLACE", domain=7, namespace="lab")
    CsvRecorder()


def plant(robot):
    with Diagram("bench", rate=5 * robot.rate) as bench:
        for joint in ("hip", "knee"):
            drive = robot[f"left/{joint}"].emulator()
            limb = Limb()(torque=drive.torque)
            drive(position=limb.position, velocity=limb.velocity)
        robot["left/thigh_imu"].emulator()()
    return bench
"""


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.mark.paced
def test_nodes_of_ros_2_find_and_receive_joints_sensors_and_diagnostics(tmp_path):
    with router() as ros:
        ros.listen(7)
        tokens = set()
        ros.session.liveliness().declare_subscriber("@ros2_lv/**", lambda sample: tokens.add(without_session(sample)))
        robot = write(tmp_path, DIAGRAM.replace("PLACE", ros.place))
        trial = runtime.run(robot, 1.5, fast=False, record=str(tmp_path / "recordings"))
        time.sleep(0.2)
        states = ros.received[ros.key(7, "lab/joint_states", JOINT_STATE)]
        sensed = ros.received[ros.key(7, "lab/left/thigh_imu", IMU)]
        told = ros.received[ros.key(7, "diagnostics", DIAGNOSTICS)]
        hashes = {kind: ros.store.hash_rihs01(kind) for kind in (JOINT_STATE, IMU, DIAGNOSTICS)}
        assert ros.tokens() == set()  # the node has left
    assert tokens == {
        "@ros2_lv/7/0/0/NN/%/%/tickwork_exo",
        *(
            f"@ros2_lv/7/0/{number}/MP/%/%/tickwork_exo/{topic}/{dds}/{hashes[kind]}/::,10:,:,:,,"
            for number, topic, dds, kind in (
                (1, "%lab%joint_states", "sensor_msgs::msg::dds_::JointState_", JOINT_STATE),
                (2, "%lab%left%thigh_imu", "sensor_msgs::msg::dds_::Imu_", IMU),
                (3, "%diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_", DIAGNOSTICS),
            )
        ),
    }
    assert len(states) == len(sensed) == len(trial) > 200  # every tick
    for ticks in (states, sensed):
        assert [number for _, _, (number, *_) in ticks] == list(range(1, len(trial) + 1))
        assert len({publisher for *_, (_, _, _, publisher) in ticks}) == 1
        stamps = np.array([stamp(message) for _, message, _ in ticks])
        assert np.allclose((stamps - stamps[0]) * 1e-9, trial.time - trial.time[0], rtol=0.0, atol=1e-6)
        came = np.array([when for when, *_ in ticks])
        sent = np.array([when for *_, (_, when, _, _) in ticks])
        assert 0.0 <= (came - sent).min() * 1e-9 < 0.003  # of Zenoh; most take longer on a busy machine
    assert states[0][1].name == ["left_hip", "left_knee"]
    for field, port in (("position", "position"), ("velocity", "velocity"), ("effort", "torque")):
        values = np.array([getattr(message, field) for _, message, _ in states])
        assert np.array_equal(values, np.column_stack([trial[f"left/{joint}.{port}"] for joint in ("hip", "knee")]))
    turned = np.array([[getattr(message.orientation, axis) for axis in "wxyz"] for _, message, _ in sensed])
    assert np.array_equal(turned, trial["left/thigh_imu.quaternion"], equal_nan=True)
    assert sensed[-1][1].header.frame_id == "left_thigh_imu" and sensed[-1][1].orientation_covariance[0] == 0.0
    for field, port in (("linear_acceleration", "accel"), ("angular_velocity", "gyro")):
        values = np.array([[getattr(getattr(message, field), axis) for axis in "xyz"] for _, message, _ in sensed])
        assert np.array_equal(values, trial[f"left/thigh_imu.{port}"])
    assert [status.name for status in told[0][1].status] == ["exo: run", "exo: left/hip", "exo: left/knee"]
    assert 2 <= len(told) <= 6
    assert told[0][1].status[0].message == "running" and told[-1][1].status[0].message.startswith("end: ok")
    assert {value.key for value in told[0][1].status[1].values} >= {"temperature", "age", "fault"}


def without_session(sample):
    """A liveliness token without the ID of its session."""
    parts = str(sample.key_expr).split("/")
    return "/".join(parts[:2] + parts[3:])


def test_the_bridge_sleeps_until_the_next_published_tick_is_due_and_then_looks_often(monkeypatch):
    bridge = object.__new__(Bridge)
    bridge.plan = {"rate": 200.0}
    bridge.shared = SimpleNamespace(began=3_000_000_000, first_tick=500_000_000, state="running")
    monkeypatch.setattr(time, "monotonic_ns", lambda: 4_501_000_000)  # tick 200 was due 1 ms ago
    assert bridge.wait(201) == pytest.approx(0.004)
    assert bridge.wait(250) == pytest.approx(0.249)
    assert bridge.wait(200) == bridge.wait(181) == LOOK_PERIOD
    assert bridge.wait(180) == IDLE_PERIOD  # no row for a tenth of a second
    bridge.shared.state = "stopping"
    assert bridge.wait(201) == IDLE_PERIOD


def test_rows_that_the_bridge_has_not_read_when_the_recorder_ends_are_published():
    shared, published = SharedState(4096), []
    theirs, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    bridge = object.__new__(Bridge)
    bridge.plan, bridge.shared, bridge.events, bridge.last = {"decimation": 1, "rate": 200.0}, shared, ours, None
    bridge.newest, bridge.unpack = NewestRow(shared, 1), Struct("<3d").unpack
    bridge.newest.keeps = True
    bridge.node = SimpleNamespace(close=lambda: None)
    bridge.publish, bridge.tell = published.append, lambda: published.append("end")
    for tick in range(3):
        shared.push(RECORD_ROW, Struct("<3d").pack(tick, 0.0, 0.5))
    theirs.close()
    with ours:
        bridge.run()
    assert published == [(0.0, 0.0, 0.5), (1.0, 0.0, 0.5), (2.0, 0.0, 0.5), "end"]


@pytest.mark.paced
def test_the_run_continues_without_its_bridge_and_without_a_router(tmp_path):
    robot = write(tmp_path, DIAGRAM.replace("PLACE", "tcp/localhost:9"))
    with started(robot, "--duration", 4, cwd=tmp_path) as run:
        until = time.monotonic() + 20.0
        while not (bridge := descendant(run.pid, "tickwork-ros2")) and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(1.5)
        os.kill(bridge, signal.SIGKILL)
        out, err = run.communicate(timeout=30.0)
    assert "ros2: 3 topics in domain 7, as soon as a router runs at tcp/localhost:9" in out + err
    assert "its process died; the run continues without it" in out + err
    assert run.returncode == 0 and len(runtime.load(tmp_path / "recordings")) > 200
