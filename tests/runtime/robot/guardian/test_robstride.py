"""A run with RobStride drives that is killed: its guardian stops them in extended frames and decodes their replies."""

import os
import select
import signal
import subprocess
import time

import pytest

from tests.blocks.actuators import robstride_reference as reference
from tests.runtime.robot.guardian.drives import open_bus
from tests.runtime.robot.guardian.robstride_drives import RS03
from tests.runtime.runs import module, started, write

pytestmark = pytest.mark.paced

MOTORS = {"hip": 11, "knee": 12}
ROBOT = """
from blocks.actuators import RobStride
from graph import Diagram


def build():
    with Diagram("leg", rate=200) as diagram:
        for name, can_id in (("hip", 11), ("knee", 12)):
            drive = RobStride(
                "RobStride03", bus="leg", can_id=can_id, range=(-12.5, 12.5), wake_shift=0.0, name=name{mode})
            drive({command})
    return diagram
"""
OPERATION, CURRENT_LIMIT = 1, bytes.fromhex("18700000")


@pytest.fixture
def leg(tmp_path):
    """(start, node): a function that starts a run on a bus of this test alone, and an observer on that bus."""
    channel = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{40 + int(time.time()) % 200}"
    rig = write(tmp_path, f'[bus.leg]\ninterface = "udp_multicast"\nchannel = "{channel}"\n', "lab.toml")
    words = [channel, *MOTORS.values()]
    drives = module("tests.runtime.robot.guardian.robstride_drives", *words, stdout=subprocess.PIPE, text=True)
    assert drives.stdout.readline() == "ready\n"
    node = open_bus(channel)

    def start(mode="", command="torque_command=2.0"):
        robot = write(tmp_path, ROBOT.format(mode=mode, command=command))
        accepted = [f"--accept={joint}.mode" for joint in MOTORS if mode]
        return started(robot, "--rig", rig, "--no-record", "--yes", *accepted, cwd=tmp_path)

    yield start, node
    drives.kill()
    drives.wait()
    drives.stdout.close()
    node.shutdown()


def hear(node, seconds, until=lambda kind, motor, frame: False):
    """(type, motor, frame) of the commands of some time, or until one is there that is awaited."""
    heard, deadline = [], time.monotonic() + seconds
    while (left := deadline - time.monotonic()) > 0 or select.select([node], [], [], 0)[0]:
        message = node.recv(max(0.0, left))
        if message is None:
            break
        kind, motor = message.arbitration_id >> 24, message.arbitration_id & 255
        if message.is_extended_id and motor in MOTORS.values():
            heard.append((kind, motor, (message.arbitration_id, bytes(message.data))))
            if until(*heard[-1]):
                break
    return heard


def torque(kind, motor, frame):
    """N·m that a frame of operation control commands."""
    return (
        reference.read_command(RS03, (frame[0] | reference.EXTENDED, frame[1]))["torque"] if kind == OPERATION else 0.0
    )


@pytest.mark.parametrize("sign", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.soak)])
def test_motors_are_stopped_by_loop_or_guardian(leg, sign):
    start, node = leg
    process = start()
    for motor in MOTORS.values():
        assert (
            torque(*hear(node, 10.0, lambda kind, to, frame: to == motor and torque(kind, to, frame) > 1.5)[-1]) > 1.5
        )  # noqa: B023
    process.send_signal(sign)
    after = hear(node, 0.6)
    out, err = process.communicate(timeout=10)
    assert "confirmed by hip, knee" in (err if sign == signal.SIGKILL else out), out + err
    for motor in MOTORS.values():
        said = [entry for entry in after if entry[1] == motor]
        end = next(place for place, entry in enumerate(said) if entry[0] == 4)
        assert {entry[0] for entry in said[end:]} <= {OPERATION, 4} and 3 not in [entry[0] for entry in said]
        assert all(abs(torque(*entry)) < 0.002 for entry in said[end - 1 :]), (
            "zero torque, then the stop, and nothing after it"
        )
        assert said[-1][0] == 4 and said[-1][2][1] == bytes(8), "which clears no fault"


def test_a_safe_stop_in_a_position_mode_sets_the_current_limit_to_zero_first(leg):
    start, node = leg
    process = start(', mode="csp", timeout=0.5', "position_command=0.1")  # the drives may be held up
    assert hear(
        node, 10.0, lambda kind, to, frame: kind == 18 and frame[1][:4] == CURRENT_LIMIT and frame[1][4:] != bytes(4)
    )
    hear(node, 0.2)
    process.kill()
    after = hear(node, 0.6)
    _, err = process.communicate(timeout=10)
    assert "confirmed by hip, knee" in err, err
    for motor in MOTORS.values():
        said = [(kind, frame[1]) for kind, to, frame in after if to == motor]
        assert said[-2:] == [(18, CURRENT_LIMIT + bytes(4)), (4, bytes(8))]
