"""Warnings of a drive become events of the recording: each bit once per run, by name."""

import struct

import pytest

from blocks.actuators import RobStride
from graph import Block, Diagram, Output
from tests.blocks.actuators import robstride_reference as reference
from tests.cext.rigs import Rig


class Reports(Block):
    """In the plant: a fault report with `warnings[tick]`, as the drive sends it."""

    y = Output("1")

    def configure(self):
        self.warnings, self.end = {}, None

    def step(self, tick):
        if tick in self.warnings:
            identifier = reference.identifier(21, 127, 0xFD) & 0x1FFFFFFF
            self.end.send(
                identifier, struct.pack("<II", 0, self.warnings[tick]), True, time=round(tick * self.dt * 1e9)
            )
        return 0.0


def warned(model, warnings):
    with Diagram("robot", rate=200) as robot:
        knee = RobStride(model, name="knee")
        knee(torque_command=0.1)
    with Diagram("plant", rate=1000) as plant:
        knee.emulator()(position=0.0, velocity=0.0)
        reports = Reports(name="reports")
    rig = Rig(robot, plant)
    reports.warnings, reports.end = warnings, rig.buses["can"].device
    outcome = rig.run(100)
    assert outcome.status == "ok", "a warning ends nothing"
    return rig, rig.events


def test_a_warning_is_announced_once_by_its_name():
    rig, events = warned("RS03", {100: 1, 200: 1, 250: 0, 300: 1})
    [event] = events
    assert (event["event"], event["device"], event["what"]) == (
        "warning",
        "knee",
        "RobStride warning: motor too hot (bit 0)",
    )
    assert 19 <= event["tick"] <= 22 and rig["knee.warning"].max() == 1


@pytest.mark.parametrize(
    "model, mask, words",
    [
        ("RS03", 1 | 1 << 3 | 1 << 31, ["motor too hot (bit 0)", "over-voltage (bit 3)", "bit 31"]),
        ("CyberGear", 1 << 2, ["under-voltage (bit 2)"]),
    ],
)
def test_several_warnings_are_announced_one_per_tick(model, mask, words):
    _, events = warned(model, {100: mask})
    family = "CyberGear" if model == "CyberGear" else "RobStride"
    assert [event["what"] for event in events] == [f"{family} warning: {each}" for each in words]
    assert [event["tick"] - events[0]["tick"] for event in events] == list(range(len(words)))


def test_without_a_warning_nothing_is_announced():
    assert warned("RS03", {})[1] == []
