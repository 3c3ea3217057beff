"""A silent or idle device: its commands without a reply, and other devices that are silent too."""

from types import SimpleNamespace

import pytest

from blocks.actuators import CubeMars
from graph import Diagram, compile
from runtime.record.report.lost_replies import also_silent, before_fault


def ended(status, missed, *, tick=120, failed_in_plant=False, errors=0):
    """A RunResult as far as it is read."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK80-9", bus="legs", name="knee", timeout=0.1)(torque_command=0.0)
    return SimpleNamespace(
        outcome=SimpleNamespace(status=status, tick=tick, culprit="knee"),
        failed_in_plant=failed_in_plant,
        schedule=SimpleNamespace(rate=200.0),
        diagram=robot,
        statistics={"frames": {"errors": errors}},
        control=SimpleNamespace(reports=SimpleNamespace(missed={"knee": missed})),
    )


@pytest.mark.parametrize(
    "status, missed, said",
    [
        ("silent", 50, "; 30 of its 100 commands before had no reply by the next one: frames are lost on bus legs. "),
        ("silent", 22, ""),  # those of the time-out, and two more
        (
            "not following",
            36,
            "; 36 of its 120 commands before had no reply by the next one: frames are lost on bus legs, perhaps also "
            "the one that enables the drive. ",
        ),
        ("not following", 2, ""),
        ("overspeed", 36, ""),
    ],
)
def test_commands_without_a_reply_explain_a_silent_or_idle_drive(status, missed, said):
    remedy = "Check wiring, termination, adapter and load of the bus"
    assert before_fault(ended(status, missed)) == (said + remedy if said else "")


def test_a_fault_of_the_plant_is_not_explained_by_the_robots_bus():
    assert before_fault(ended("silent", 50, failed_in_plant=True)) == ""


@pytest.mark.parametrize(
    "ages, said", [((0.11, 0.04), ""), ((0.11, 0.06), "; 1 other device is silent as well (hip): ")]
)
def test_other_silent_devices_are_named(ages, said):
    with Diagram("robot", rate=200) as robot:
        for can_id, name in enumerate(("knee", "hip"), 1):
            CubeMars("AK80-9", bus="legs", can_id=can_id, name=name, timeout=0.1)(torque_command=0.0)
    schedule = compile(robot)
    values = schedule.arena.copy()
    for name, age in zip(("knee", "hip"), ages):
        values[schedule.signals[f"{name}.age"].slot] = age
    result = ended("silent", 0)
    result.diagram, result.schedule, result.control.final = robot, schedule, values
    remedy = "check what they share, such as a hub, a supply or the load of the computer"
    assert also_silent(result) == (said + remedy if said else "")


def test_error_frames_of_the_controller_explain_a_silence():
    text = before_fault(ended("silent", 22, errors=1200))
    assert text == (
        "; the CAN controllers reported 1200 error frames: check wiring, termination and bitrate of bus legs"
    )
    assert before_fault(ended("silent", 50, errors=3)).startswith(
        "; the CAN controllers reported 3 error frames; 30 of"
    )
    assert before_fault(ended("not finite", 50, errors=3)) == ""
