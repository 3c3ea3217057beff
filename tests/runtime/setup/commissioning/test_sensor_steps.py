"""The steps of `commission` for inertial sensors: two of each family, and what a hand does with them."""

import json
import math
import os
import re
import threading
import time

import numpy as np
import pytest

from blocks.imus import OpenImu
from graph import Diagram
from runtime.robot.rig.records import records_of
from runtime.setup.commissioning.guided import sensors
from runtime.setup.commissioning.guided.sensors import Motion
from tests.runtime.runs import started, write
from tests.runtime.setup.commissioning.nodes import channel
from tests.runtime.terminals import Terminal

RATE, G = 200.0, 9.81


def block(rate=100.0):
    with Diagram("legs", rate=200):
        return OpenImu(rate=rate, name="imu")


def motion(angle=lambda t: 0.0, seconds=6.0, noise=0.0, period=0.01, axis=0, mix=np.eye(3), lost=0.0):
    """Motion of a sensor that is turned by `angle` about an axis. mix : matrix of a fault of the angular rate"""
    random, time = np.random.default_rng(1), np.arange(0.0, seconds, 1.0 / RATE)
    angles = np.array([angle(t) for t in time])
    accel, gyro = np.zeros((len(time), 3)), np.zeros((len(time), 3))
    first, second = [each for each in range(3) if each != axis]
    sign = 1.0 if axis != 1 else -1.0
    accel[:, first], accel[:, second] = sign * G * np.sin(angles), G * np.cos(angles)
    gyro[:, axis] = np.gradient(angles, 1.0 / RATE)
    arrived = time // period * period
    for index in np.flatnonzero(random.random(len(time)) < lost):
        arrived[index : index + 4] = arrived[index - 1] if index else 0.0
    return Motion(time, accel + random.normal(0.0, noise, accel.shape), gyro @ mix.T, time - arrived)


def bent(t, most=0.8, begin=1.0, rate=0.5):
    return min(most, max(0.0, rate * (t - begin)))


def returned(t, end=0.0):
    return max(end, 0.8 - 0.5 * max(0.0, t - 1.0))


@pytest.mark.parametrize(
    "more, finding",
    [
        ({}, None),
        ({"noise": 0.05}, None),
        ({"noise": 0.8}, "noisy sensor"),
        ({"period": 0.02}, "sample rate"),
        ({"period": 0.004}, "sample rate"),
        ({"lost": 0.1}, "drop-outs"),
    ],
)
def test_a_sensor_at_rest_is_compared_with_its_block(more, finding):
    result = sensors.rest_of(block(), motion(seconds=2.0, **more))
    assert [name for name, _ in result.findings] == ([] if finding is None else [finding]), result


@pytest.mark.parametrize("in_turn", [1, 2, 40])
def test_two_sensors_with_one_address_alternate_and_a_shaken_one_does_not(in_turn):
    """Two sensors at rest, one tilted by 0.3 rad. One whose values stay for 0.4 s each is moved to and fro."""
    still = motion(seconds=4.0, noise=0.02)
    other = (still.time // (0.01 * in_turn)) % 2 > 0.0
    tilted = np.array([[1.0, 0.0, 0.0], [0.0, math.cos(0.3), -math.sin(0.3)], [0.0, math.sin(0.3), math.cos(0.3)]])
    both = Motion(still.time, np.where(other[:, None], still.accel @ tilted, still.accel), still.gyro, still.age)
    [(name, _)] = sensors.rest_of(block(), both).findings
    assert name == ("two sensors with one address" if in_turn < 40 else "noisy sensor")
    assert not sensors.alternates(np.repeat(np.eye(3), 50, axis=0)), "a value that changes once or twice"


def test_samples_that_arrive_in_bursts_are_no_drop_outs_where_the_sensor_counts_them():
    burst = motion(seconds=2.0, period=0.04)
    counted = Motion(burst.time, burst.accel, burst.gyro, burst.age, rate=100.0)
    assert sensors.rest_of(block(), burst).findings and not sensors.rest_of(block(), counted).findings


def test_other_scales_and_a_bias_are_named():
    still = motion(seconds=2.0)
    half = Motion(still.time, still.accel / 2.0, still.gyro, still.age)
    biased = Motion(still.time, still.accel, still.gyro + 0.2, still.age)
    assert sensors.rest_of(block(), half).findings[0][0] == "scale of the sensor"
    assert sensors.rest_of(block(), biased).findings[0][0] == "bias of the sensor"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_healthy_sensor_agrees_about_every_axis(axis):
    out, back = {"left": motion(bent, axis=axis)}, {"left": motion(returned, axis=axis)}
    result = sensors.bend_of("left", out, back)
    assert not result.findings and result.measured["turned"] == pytest.approx(0.8, abs=0.01), result
    assert result.measured["axes_error"] < 0.02 > result.measured["shift"]


CYCLIC = np.roll(np.eye(3), 1, axis=0)
EXCHANGED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    "out, back, finding",
    [
        ({"left": motion(), "right": motion(bent)}, {"left": motion(), "right": motion(returned)}, "exchanged"),
        ({"left": motion(bent, mix=-np.eye(3))}, {"left": motion(returned)}, "axes"),
        ({"left": motion(bent, mix=EXCHANGED)}, {"left": motion(returned)}, "axes"),
        ({"left": motion(bent, mix=2.0 * np.eye(3))}, {"left": motion(returned)}, "scale of the sensor"),
        ({"left": motion(bent, mix=math.degrees(1.0) * np.eye(3))}, {"left": motion(returned)}, "scale of the sensor"),
        ({"left": motion(bent, mix=math.radians(1.0) * np.eye(3))}, {"left": motion(returned)}, "scale of the sensor"),
        ({"left": motion(bent, mix=np.zeros((3, 3)))}, {"left": motion(returned)}, "no angular rate"),
        ({"left": motion(bent, mix=CYCLIC)}, {"left": motion(returned)}, "axes"),
        ({"left": motion(bent)}, {"left": motion(lambda t: returned(t, end=0.15))}, "loose sensor"),
        ({}, {}, "silent"),
    ],
    ids=["exchanged", "negated", "axes", "scale", "degrees", "radians", "no rate", "cyclic", "loose", "absent"],
)
def test_each_fault_of_a_sensor_is_named_when_its_segment_is_bent(out, back, finding):
    assert [name for name, _ in sensors.bend_of("left", out, back).findings] == [finding]


@pytest.mark.parametrize("most", [0.4, 0.8, 1.2])
@pytest.mark.parametrize(
    "mix", [-np.eye(3), EXCHANGED, CYCLIC, -CYCLIC], ids=["negated", "exchanged", "cyclic", "both"]
)
def test_axes_are_not_taken_for_another_unit(mix, most):
    out = {"left": motion(lambda t: bent(t, most), mix=mix, noise=0.02)}
    assert [name for name, _ in sensors.bend_of("left", out, out).findings] == ["axes"]


def shaken(t, rings=0.0):
    """To and fro three times in 1.5 s, on the way back. rings : rad, of a sensor that oscillates with 8 Hz after it"""
    part = min(max((t - 1.0) / 1.5, 0.0), 1.0)
    decay = rings * np.exp(-3.0 * max(0.0, t - 1.0)) * (t > 1.0)
    return returned(t) + 0.3 * np.sin(np.pi * part) * np.sin(6.0 * np.pi * part) + decay * np.sin(50.0 * t)


@pytest.mark.parametrize("rings, finding", [(0.0, []), (0.05, ["loose sensor"])])
def test_a_sensor_that_oscillates_while_its_segment_is_shaken_is_loose(rings, finding):
    back = {"left": motion(lambda t: shaken(t, rings), seconds=8.0, noise=0.05)}
    result = sensors.bend_of("left", {"left": motion(bent)}, back)
    assert [name for name, _ in result.findings] == finding, result


def test_where_no_sensor_has_turned_nothing_is_claimed():
    result = sensors.bend_of("left", {"left": motion()}, {"left": motion()})
    assert not result.done and not result.findings


ROBOT = '''
import json, math
from blocks.imus import *
from blocks.imus.openimu.emulator import EmulatedOpenImu
from graph import Block, Diagram, Output, Param

FOLDER, MOVED, FAULTS = {folder!r}, {moved!r}, {faults!r}


class Segment(Block):
    """Segment that a hand bends about the sensor's y axis. about : axis of the angular rate that its sensor reports"""

    about = Param(1, "1")

    accel = Output("m/s²", shape=(3,))
    gyro = Output("rad/s", shape=(3,))

    def reset(self):
        self.at, self.speed, self.target = 0.0, 0.0, 0.0

    def step(self):
        rate = [0.0, 0.0, 0.0]
        rate[self.about] = self.speed
        return (9.81 * math.sin(self.at), 0.0, -9.81 * math.cos(self.at)), tuple(rate)

    def update(self, tick):
        if tick % 20 == 0:
            try:
                self.target = json.load(open(FOLDER + "/hand.json")).get(self.path, 0.0)
            except (OSError, ValueError):
                pass
        left = self.target - self.at
        self.speed = math.copysign(min(0.6, 8.0 * abs(left)), left)
        self.at += self.speed * self.dt


def build():
    with Diagram("legs", rate=200) as diagram:
        for address, name in enumerate(MOVED, 128):
            {block}
    return diagram


def plant(robot):
    with Diagram("legs_plant", rate=1000) as plant:
        for name, moved in MOVED.items():
            faults = dict(FAULTS.get(name, {{}}))
            segment = Segment(name=moved, about=faults.pop("about", 1))
            {emulator}.of(robot[name], name="imu_" + name, **faults)(accel=segment.accel, gyro=segment.gyro)
    return plant
'''


CAN = '[bus.imus]\ninterface = "udp_multicast"\nchannel = "{channel}"\nbitrate = 250_000\n'
I2C = '[bus.imus]\ninterface = "i2c"\nchannel = "unix:{folder}/chips"\n'
KINDS = {  # block, class of its emulator, rig
    "OpenIMU": ('OpenImu(bus="imus", address=address, name=name)', "EmulatedOpenImu", CAN),
    "MicroStrain": ("MicroStrain(serial=str(address), name=name)", "EmulatedMicroStrain", ""),
    "MPU-9250": ('MPU9250("imus", 0x68 + address - 128, magnetometer=False, name=name)', "EmulatedMPU9250", I2C),
}
HELD, EXCHANGED_SIDES = {"left": "left", "right": "right"}, {"left": "right", "right": "left"}
CASES = [  # kind, segment of each sensor, faults of the left one, finding on it; the right one is healthy if worn right
    ("OpenIMU", HELD, {}, None),
    ("OpenIMU", EXCHANGED_SIDES, {}, "exchanged"),
    ("MicroStrain", HELD, {"about": 0}, "axes"),
    ("MicroStrain", EXCHANGED_SIDES, {}, "exchanged"),
    ("MPU-9250", HELD, {"accel_range": 16}, "scale of the sensor"),
    ("MPU-9250", HELD, {"gyro_range": 500}, "scale of the sensor"),
    ("MPU-9250", EXCHANGED_SIDES, {}, "exchanged"),
]


@pytest.mark.soak
@pytest.mark.paced
@pytest.mark.parametrize("kind, moved, faults, finding", CASES, ids=lambda value: str(value)[:24])
def test_sensors_are_commissioned_and_each_fault_is_named(tmp_path, monkeypatch, kind, moved, faults, finding):
    monkeypatch.setenv("TICKWORK_PORTS", str(tmp_path / "ports" / "tty*"))
    block, emulator, rig = KINDS[kind]
    given = {"folder": str(tmp_path), "moved": moved, "faults": {"left": faults}}
    robot = write(tmp_path, ROBOT.format(block=block, emulator=emulator, **given))
    rig = write(tmp_path, rig.format(channel=channel(133), folder=tmp_path), "lab.toml")
    plant = started("emulate", robot, "--rig", rig, "--lines", tmp_path / "ports", cwd=tmp_path)

    def hold(**angles):
        (tmp_path / "hand.new").write_text(json.dumps(angles))
        os.replace(tmp_path / "hand.new", tmp_path / "hand.json")

    try:
        while "Ctrl-C ends it" not in (line := plant.stdout.readline()):
            assert line, plant.stderr.readlines()
        with Terminal() as terminal:
            terminal.run("commission", rig, robot, "--name", "E. Person", cwd=tmp_path)
            text, asked, then, end = "", 0, None, time.monotonic() + 200.0
            while terminal.process.poll() is None:
                assert time.monotonic() < end, text
                text += terminal.look()
                terminal.shown = b""
                questions = re.findall(r"  > .*\n", text)
                if len(questions) > asked:
                    asked += 1
                    time.sleep(0.3)  # what is typed before a question is shown does not answer it
                    os.write(terminal.master, b"\n")
                    if found := re.search("segment of (left|right)", questions[-1]):
                        then = {found[1]: 0.8}
                    elif "again" in questions[-1]:
                        then = {}
                if then is not None and "running" in text[text.rindex("  > ") :].partition("\n")[2]:
                    threading.Timer(0.8, hold, kwargs=then).start()
                    then = None
                time.sleep(0.02)
            text += terminal.look()
        records = records_of(rig)
        wanted = {"left": [finding] if finding else [], "right": ["exchanged"] if moved is EXCHANGED_SIDES else []}
        assert terminal.process.returncode == bool(finding), text
        assert {path: [name for name, _ in each.findings] for path, each in records.items()} == wanted, text
        if kind == "MicroStrain":
            assert records["right"].serial == "6253.129" and records["right"].firmware == "1.1.6"
    finally:
        plant.kill()
        plant.communicate()
