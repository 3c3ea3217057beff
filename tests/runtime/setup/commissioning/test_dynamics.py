"""Friction and inertia in virtual time: estimates within a tolerance, honest intervals, and the name of each fault."""

import math
import random

import pytest

from runtime.robot.rig.records import AGREES, OPEN, Record, StepRecord, of_text
from runtime.setup.commissioning.guided import dynamics
from runtime.setup.commissioning.guided.bench import Given
from runtime.setup.commissioning.guided.driven import rated_of
from tests.runtime.setup.commissioning.moved import block_of, moved

AK80 = ("CubeMars", "AK80-9")
DRIVES = [AK80, ("CubeMarsServo", "AK60-6-V1.1"), ("RobStride", "RS02"), ("CubeMarsV3", "AK80-9-V3.0")]
DRIVES += [("RobStrideMIT", "RS04")]


def measured(joint, drive=AK80, **faults):
    """(DynamicsProbe, the joint, the block) of an emulated drive that moves a joint."""
    block = block_of(*drive, range=(-2.0, 2.0))
    robot, probe = dynamics.dynamics_diagram(block, math.pi / 2.0)
    outcome, arm = moved(robot, joint, probe.duration, **faults)
    assert probe.ended, (outcome.status, outcome.error)
    assert 0.0 < arm.most <= 0.05 * rated_of(block) or faults
    return probe, arm, block


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("rounds", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_estimates_are_near_and_their_intervals_contain_the_truth_nine_times_in_ten(rounds):
    chance, inside, all_of_them = random.Random(7), 0, 0
    for drive in DRIVES * rounds:
        limit = 0.05 * rated_of(block_of(*drive))
        joint = {
            "inertia": 0.004 * 40.0 ** chance.random() * max(1.0, limit / 0.45),
            "friction": limit * chance.uniform(0.1, 0.6),
            "viscous": limit * chance.uniform(0.0, 0.15),
        }
        probe, arm, block = measured(joint, drive)
        found = dynamics.identified_by(probe)
        assert found.joint.inertia.value == pytest.approx(arm.inertia, rel=0.03), (drive, joint)
        assert found.joint.coulomb.value == pytest.approx(arm.friction, rel=0.05), (drive, joint)
        assert found.ripple is None and len(found.points) >= 6, (drive, joint)
        pairs = [(found.joint.inertia, arm.inertia), (found.joint.coulomb, arm.friction)]
        pairs += [(found.joint.viscous, arm.viscous)]
        pairs += [
            (point.torque, math.copysign(arm.friction, point.speed) + arm.viscous * point.speed)
            for point in found.points
        ]
        inside += sum(abs(estimate.value - truth) <= estimate.error for estimate, truth in pairs)
        all_of_them += len(pairs)
        assert all(estimate.error < 0.15 * limit for estimate, _ in pairs)
    assert 0.85 * all_of_them <= inside < all_of_them, (inside, all_of_them)


def test_a_ripple_is_seen_and_the_feel_is_described(tmp_path):
    probe, arm, block = measured({"inertia": 0.02, "friction": 0.1, "cogging": 0.05})
    lever = StepRecord("", "", {"ratio": 0.8})
    given = Given(1.0, picture=tmp_path / "knee.png", steps={"torque": lever})
    result = dynamics.dynamics_of(block, probe, given)
    assert not result.findings and given.picture.read_bytes().startswith(b"\x89PNG")
    assert result.measured["ripple_order"] == pytest.approx(36, abs=2)
    assert result.measured["ripple"] == pytest.approx(0.8 * 0.05, rel=0.2)
    assert result.measured["inertia"] == pytest.approx(0.8 * 0.02, rel=0.05)
    assert abs(result.measured["torque_backward_at_1600"]) == pytest.approx(0.08, rel=0.15)
    step = StepRecord("", AGREES, result.measured, result.says)
    record = Record("S1", "knee", "CubeMars", "AK80-9", signed={"name": "E", "date": "2026-12-01"})
    record.steps["dynamics"] = step
    assert of_text(record.text(), given.picture).steps["dynamics"] == step
    words = result.says[-2]
    assert "0.3 m from the axis: hardly felt" in words and "% of the rated torque" in words, result.says


LEFT_OPEN = {  # parameters of the joint, part of the reason
    "held": ({"friction": 2.0}, "hardly moved"),
    "at its end": ({"start": 1.5}, "not within its range"),
    "falls": ({"weight": 3.0, "start": 0.5}, "without torque the joint turned"),
}


@pytest.mark.parametrize("case", LEFT_OPEN)
def test_a_joint_that_cannot_be_measured_is_no_fault(case):
    joint, reason = LEFT_OPEN[case]
    probe, _, block = measured({"inertia": 0.02} | joint, inputs={})
    result = dynamics.dynamics_of(block, probe, Given(1.0))
    assert result.verdict == OPEN and reason in result.says[0]


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize(
    "faults, finding", [({"torque_scale": -1.0}, "sign of torque"), ({"torque_scale": 8.0}, "runaway")]
)
def test_a_fault_of_the_drive_is_named(faults, finding):
    probe, _, block = measured({"inertia": 0.01, "friction": 0.05}, **faults)
    assert [name for name, _ in dynamics.dynamics_of(block, probe, Given(1.0)).findings] == [finding]
