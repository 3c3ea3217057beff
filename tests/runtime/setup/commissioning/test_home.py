"""Homing against a stop in virtual time: where it is on healthy joints, and the name of each fault."""

from types import SimpleNamespace

import pytest

from runtime.robot.rig.records import AGREES, OPEN, StepRecord
from runtime.setup.commissioning.guided import home
from runtime.setup.commissioning.guided.driven import rated_of
from tests.runtime.setup.commissioning.moved import block_of, moved
from tests.soaking import soaked

AK80 = ("CubeMars", "AK80-9")
WANTED = home.Home(-1.0, 0.45, 1.0, 1.6)


def homed(block, joint, wanted=WANTED, steps=None, **faults):
    """(Result, the joint) of homing an emulated drive."""
    robot, probe = home.homing_diagram(block, wanted)
    outcome, arm = moved(robot, {"lower": -1.2} | joint, wanted.duration, **faults)
    assert probe.ended, (outcome.status, outcome.tick, outcome.error, probe.at, probe.stops)
    return home.home_of(block, wanted, probe, steps or {}), arm


HEALTHY = {  # block, parameters of the joint
    "light": (AK80, {"inertia": 0.004, "friction": 0.05}),
    "light and sticking": (AK80, {"inertia": 0.004, "friction": 0.2, "sticking": 0.5}),
    "little friction": (AK80, {"inertia": 0.005, "friction": 0.01}),
    "heavy": (AK80, {"inertia": 0.5, "friction": 0.1}),
    "much friction": (AK80, {"inertia": 0.05, "friction": 0.38}),
    "cogging": (AK80, {"inertia": 0.005, "friction": 0.08, "cogging": 0.05}),
    "weight": (AK80, {"inertia": 0.02, "friction": 0.1, "weight": 0.25}),
    "at its stop": (AK80, {"start": -1.19}),
    "servo": (("CubeMarsServo", "AK60-6-V1.1"), {"inertia": 0.004, "friction": 0.05}),
    "board": (("CubeMarsV3", "AK80-9-V3.0"), {"friction": 0.1}),
    "private": (("RobStride", "RS02"), {"inertia": 0.005, "friction": 0.08}),
    "MIT protocol": (("RobStrideMIT", "RS04"), {"friction": 0.5}),
}


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("joint", soaked(HEALTHY, but=[2, 8, 11]))
def test_a_stop_is_found_where_it_is_at_the_torque_and_speed_allowed(joint):
    (kind, model), parameters = HEALTHY[joint]
    block = block_of(kind, model, range=(-1.2, 0.5))
    wanted = home.Home(-1.0, 0.05 * rated_of(block), 1.0, 1.6)
    result, arm = homed(block, parameters, wanted)
    assert not result.findings and result.done, result
    assert result.measured["stop"] == pytest.approx(-1.2, abs=0.01) and result.measured["spread"] < 0.01
    assert arm.most <= wanted.torque


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("weight, friction", [(0.6, 0.06), (1.0, 0.15), (3.5, 0.06), (6.0, 0.1), (20.0, 0.06)])
def test_the_weight_of_a_link_is_not_taken_for_a_stop(weight, friction):
    """Its weight holds the joint at the same angle each time, at the largest torque."""
    block = block_of(*AK80, range=(-1.2, 0.5))
    result, arm = homed(block, {"inertia": 0.06, "friction": friction, "weight": weight})
    assert result.verdict == OPEN and not result.cures, result
    assert "its link" in result.says[0] and "not a stop" in result.says[0] and arm.most <= WANTED.torque


FAULTS = {  # parameters of the joint, faults of the emulator, the finding
    "no stop": ({"lower": -9.0}, {}, "no stop"),
    "slips": ({"yields": 0.05}, {}, "stop not repeated"),
    "blocked": ({"friction": 2.0}, {}, "stuck"),
    "encoder": ({}, {"inputs": {"stuck_encoder": lambda t: t > 3.0}}, "stuck"),
    "against": ({}, {"torque_scale": -1.0}, "sign of torque"),
    "against and light": ({"inertia": 0.004, "friction": 0.02}, {"torque_scale": -1.0}, "sign of torque"),
    "strong": ({"inertia": 0.004, "friction": 0.02}, {"torque_scale": 20.0}, "runaway"),
    "zero": ({"lower": -1.0}, {}, "zero"),
    "binds": ({"lower": -0.9}, {}, "stop before the end"),
}


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_homing_is_named(fault):
    joint, faults, finding = FAULTS[fault]
    block = block_of("CubeMars", "AK80-9", range=(-1.2, 0.5))
    steps = {"motion": SimpleNamespace(measured={"low": -1.2, "high": 0.5})} if fault == "binds" else {}
    result, arm = homed(block, joint, steps=steps, **faults)
    assert [name for name, _ in result.findings] == [finding], result
    if finding == "zero":
        assert result.cures["offset"] == pytest.approx(0.2, abs=0.01)
    assert fault == "strong" or arm.most <= 0.05 * rated_of(block)


@pytest.mark.parametrize("lower, found", [(-1.2, []), (-0.9, ["range"])])
def test_both_stops_are_one_record_and_their_range_is_compared(lower, found):
    block = block_of(*AK80, range=(-1.2, 0.5))
    before = StepRecord("", AGREES, {"stop": 0.5, "upper": 0.5, "spread": 0.0})
    result, _ = homed(block, {"lower": lower}, steps={"home": before})
    assert [name for name, _ in result.findings] == found and not result.cures, result
    assert (result.measured["lower"], result.measured["upper"]) == pytest.approx((lower, 0.5), abs=0.01)
    assert result.measured["stop"] == result.measured["lower"] and "both stops" in result.says[1]
