"""Report of each fault of an actuator's motion and torque: the value, its permitted range and the remedy."""

import re

import pytest

from cext.schedule.outcome import STATUS
from runtime.record.report import drive_faults, fault
from runtime.session.prepare import prepare
from runtime.session.request import Request
from runtime.session.session import Session
from tests.runtime.runs import write

ROBOT = """
import math

from blocks.actuators import {drive}
from blocks.sources import StepSource
from graph import Block, Diagram, Output


class Joint(Block):
    position, velocity, dead = Output("rad"), Output("rad/s"), Output("1", dtype=bool)

    def step(self, t):
        return *({motion}), 0.2 <= t < 0.25


with Diagram("robot", rate=200) as diagram:
    knee = {drive}("{model}", name="knee", {parameters})
    knee({commands})


def plant(robot):
    with Diagram("plant", rate=1000) as bench:
        joint = Joint()
        robot["knee"].emulator({emulator})(position=joint.position, velocity=joint.velocity{faults})
    return bench
"""


SAID = {
    "acceleration": (
        {"motion": "0.0, 6.0 * math.sin(120.0 * t)", "commands": "damping_command=0.2"},
        r"the joint accelerates by up to [5-7]\d\d rad/s², more than its max_acceleration of 500 rad/s², on which "
        r".* raise max_acceleration",
    ),
    "excess torque": (
        {
            "motion": "0.1 + 0.4 * min(max(t - 0.3, 0.0), 1.0), 0.4 * (0.3 < t < 1.3)",
            "commands": "position_command=0.1, stiffness_command=10.0",
            "emulator": "wire_stiffness=5e3",
        },
        r"the drive measures -\d+(?:\.\d)? N·m, above its limit of 9 N·m by more than the assumed accuracy of 1.8 N·m. "
        r"Compare wire_stiffness, wire_damping and",
    ),
    "over-travel": (
        {"motion": "t, 1.0", "parameters": "range=(-0.1, 0.5)"},
        r"position 0.55\d rad is outside the joint's range of -0.1 to 0.5 rad\. Find the cause before you arm it",
    ),
    "overspeed": (
        {"motion": "0.0, 40.0 * t", "parameters": "max_velocity=10.0"},
        r"velocity 10.\d rad/s exceeds max_velocity, 10 rad/s",
    ),
    "overspeed by default": (
        {"motion": "0.0, 40.0 * t", "model": "AK80-64"},
        r"velocity 8 rad/s exceeds max_velocity, 7.96 rad/s by default",
    ),
    "not following": (
        {"commands": "torque_command=3.0", "faults": ", power_lost=joint.dead"},
        r"the drive outputs 0.\d+ N·m, but \d.\d+ N·m are commanded: it was disabled, for instance by a loss of power, "
        r"or it has reached an internal limit",
    ),
    "scale mismatch": (
        {"motion": "0.5 * math.sin(5.0 * t), 2.5 * math.cos(5.0 * t)", "emulator": "wire_velocity=25.64"},
        r"the reported velocity is 1.95 times the rate of the reported position: set wire_velocity=25.6\d?, or "
        r"wire_position=24.\d+, whichever is the range",
    ),
    "scale mismatch of a board V3.0": (
        {
            "drive": "CubeMarsV3",
            "model": "AK80-9-V3.0",
            "motion": "0.5 * math.sin(5.0 * t), 2.5 * math.cos(5.0 * t)",
            "emulator": "pole_pairs=14",
        },
        r"the reported velocity is 0.66\d times the rate of the reported position: the drive does not have the pole "
        r"pairs or the gear of AK80-9-V3.0",
    ),
    "scale mismatch of torque": (
        {
            "drive": "CubeMarsV3",
            "model": "AK80-9-V3.0",
            "commands": "torque_command=3.0",
            "emulator": "torque_constant=0.945",
        },
        r"the measured torque is 0.60\d times the commanded law: wire_torque, wire_stiffness, wire_damping or the "
        r"torque constant of AK80-9-V3.0 do not match",
    ),
    "scale mismatch of a stuck encoder": (
        {"motion": "0.0, 2.0"},
        "the reported position is constant while the reported velocity changes. Check the encoder",
    ),
    "position jump": (
        {"motion": "(0.1 if t < 0.3 else 0.1 + 1.396), 0.0", "commands": "position_command=0.1, stiffness_command=5.0"},
        r"the reported angle changed by 1.39\d rad, 2 motor turns between two replies, and motion explains at most "
        r"0.0\d+ rad: the drive has restarted or lost count of its turns, its encoder is defective, or another "
        r"drive has the same id 1. Compare the angle with the joint before you arm it again",
    ),
    "silent for as long as a restart takes": (
        {
            "drive": "CubeMarsV3",
            "model": "AK80-9-V3.0",
            "faults": ', delay=StepSource(before=0.0, after=0.03, time=0.2, unit="s")()',
        },
        r"no reply for longer than its restart_time \(0.012 s, or two periods\): it may have restarted, .* A USB "
        r"adapter that delivers replies in bursts has the same effect: set its latency timer to 1 ms, or use an "
        r"interface with native SocketCAN",
    ),
    "implausible": (
        {
            "drive": "RobStride",
            "model": "RS02",
            "faults": ', temperature=StepSource(before=30.0, after=-100.0, time=0.2, unit="°C")()',
        },
        r"implausible temperature -100 °C: the drive's sensor is defective, or the drive is not of the model RS02",
    ),
}


@pytest.mark.parametrize("what", SAID)
def test_every_motion_and_torque_fault_reports_value_bound_and_remedy(tmp_path, what):
    given, said = SAID[what]
    usual = {
        "drive": "CubeMars",
        "model": "AK80-9",
        "motion": "0.1, 0.0",
        "parameters": "",
        "commands": "torque_command=0.0",
        "emulator": "",
        "faults": "",
    }
    path = write(tmp_path, ROBOT.format(**usual | given))
    result = Session(prepare(Request(path, duration=3.0, fast=True, record=tmp_path / "out"))).carry_out()
    lines = fault.explain(result)
    assert re.fullmatch(rf"FAULT at knee, tick \d+ \([\d.]+ s\): {said}.*", lines[0]), lines[0]
    assert result.outcome.status == re.split(" of | by | for ", what)[0]


def test_every_fault_has_a_text():
    texts = fault.TEXTS.keys() | drive_faults.WORDS.keys()
    assert texts == set(STATUS.values()) - {"ok"}, (
        "a text belongs to TEXTS of fault.py, of a monitor to drive_faults.WORDS"
    )
