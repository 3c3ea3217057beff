"""The step for encoded stiffness and damping, in virtual time: healthy drives agree, other ranges are named."""

import math

import pytest

from graph import Diagram
from runtime.robot.rig.records import AGREES, DIFFERS, OPEN, StepRecord
from runtime.setup.commissioning.guided import driven, law
from runtime.setup.commissioning.guided.bench import Given
from tests.cext.rigs import Rig
from tests.runtime.setup.commissioning.test_driven import HEALTHY, LEVER, Hanging, block_of
from tests.soaking import soaked


def carried_out(block, friction=0.0, known=None, start=0.0, **faults):
    """(Result of the step, largest torque) of an emulated drive.

    friction : of the rated torque; known : the same, as the step `torque` has measured it
    start : rad, where the lever begins to hang; friction leaves it beside its balance
    """
    moment = 1.2 * driven.USED_SHARE * driven.rated_of(block) / driven.STEEPEST / driven.GRAVITY
    lever = driven.Lever(moment / LEVER, LEVER)
    robot, probe = law.law_diagram(block, lever)
    with Diagram("plant", rate=2000) as plant:
        arm = Hanging(moment=moment, length=LEVER, start=start, friction=friction * driven.rated_of(block))
        drive = robot["joint"].emulator(name="drive", **faults)
        arm(drive.torque)
        drive(position=arm.position, velocity=arm.velocity)
    outcome = Rig(robot, plant).run(math.ceil(probe.duration * driven.RATE))
    assert probe.ended, (outcome.status, outcome.tick)
    before = None if known is None else driven.Friction(known * driven.rated_of(block))
    return law.law_of(block, lever, probe, before=before), arm.most


LAWS = [name for name, (kind, *_) in HEALTHY.items() if kind != "CubeMarsServo"]


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("drive", soaked(LAWS, but=[0, 3, 6, 9]))
def test_stiffness_and_damping_of_a_healthy_drive_agree(drive):
    block = block_of(*HEALTHY[drive])
    result, most = carried_out(block)
    assert not result.findings and result.done, result
    assert result.measured == pytest.approx({"stiffness": 1.0, "damping": 1.0}, abs=0.15), result
    assert 0.02 * driven.rated_of(block) < most <= 0.05 * driven.rated_of(block)


FAULTS = {  # block, model, faults of the emulator, the finding
    "stiffness tenfold": ("RobStrideMIT", "RS04", {"wire_stiffness": 5000.0}, "stiffness range"),
    "stiffness a tenth": ("RobStride", "RS04", {"wire_stiffness": 500.0}, "stiffness range"),
    "damping twentyfold": ("RobStrideMIT", "RS03", {"wire_damping": 100.0}, "damping range"),
    "damping a twentieth": ("RobStride", "RS03", {"wire_damping": 5.0}, "damping range"),
    "stiffness twofold": ("CubeMars", "AK80-9", {"wire_stiffness": 1000.0}, "stiffness range"),
}


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("fault", FAULTS)
def test_another_encoded_gain_is_named_before_5_percent_of_rated(fault):
    kind, model, faults, finding = FAULTS[fault]
    block = block_of(kind, model, {})
    result, most = carried_out(block, **faults)
    assert [name for name, _ in result.findings] == [finding], result
    assert 0.0 < most <= 0.05 * driven.rated_of(block)


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("friction, known", [(0.02, 0.02), (0.02, None), (0.06, None)])
def test_friction_is_not_taken_for_another_encoded_gain(friction, known):
    result, _ = carried_out(block_of(*HEALTHY["MIT mode"]), friction, known)
    assert not result.findings and not result.done and "friction" in result.says[-1], result


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("start", [-0.3, -0.15, 0.15, 0.3])
@pytest.mark.parametrize("friction", [0.01, 0.02, 0.035])
def test_friction_that_holds_a_lever_beside_its_balance_is_not_taken_for_another_encoded_gain(friction, start):
    """The step before leaves it there, on either side."""
    result, _ = carried_out(block_of(*HEALTHY["MIT mode"]), friction, friction, start)
    assert not result.findings, result


def test_a_gain_of_a_tenth_is_named_beside_friction_that_is_known():
    result, _ = carried_out(block_of(*HEALTHY["MIT mode"]), 0.005, 0.005, wire_stiffness=50.0)
    assert [name for name, _ in result.findings] == ["stiffness range"], result


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("late", [[False], [True, False], [True, True]])
def test_gains_that_late_replies_have_replaced_are_measured_once_more(monkeypatch, late):
    """The block holds both at zero for a second then, and the lever hangs as without stiffness."""
    left = iter(late)

    def run(bench, diagram, ticks):
        probe = diagram["probe"]
        probe.reset()
        probe.rows = [("+", 0.0, 0.1, 0.0, 0.0), ("-", 0.0, -0.1, 0.0, 0.0)] * 50
        probe.limited_ticks = 20 * next(left)

    monkeypatch.setattr(law, "run_on_rig", run)
    steps = {"torque": StepRecord("", AGREES, {"ratio": 1.0})}
    given = Given(0.0, steps=steps, lever=driven.Lever(1.0, LEVER))
    result = law.law(None, block_of(*HEALTHY["MIT mode"]), given)
    assert next(left, None) is None
    assert (result.verdict, bool(result.findings)) == ((OPEN, False) if late[-1] else (DIFFERS, True)), result
