"""The hip exoskeleton, in virtual time: its sensors measure the thighs and its torque assists their motion."""

import numpy as np
import pytest

import runtime
from graph import compile
from runtime.robot.loading.file import build_plant, load
from tests.blocks.running import run
from tests.runtime.runs import KNEE_EXO

HIP_EXO = KNEE_EXO.with_name("hip_exo.py")
SIDES = ("left", "right")


@pytest.fixture(scope="module")
def walked():
    file, diagram = load(HIP_EXO)
    return run(diagram, 1600, plant=build_plant(file, diagram), substeps=5, fade=0.5)


def steady(recording, path):
    return recording[path][recording.time >= 3.0]


def test_diagram_compiles_without_warning_and_natively():
    schedule = compile(load(HIP_EXO)[1])
    assert schedule.warnings == [] and schedule.gil_sections == 0
    assert [proof.bounded_by for proof in schedule.proofs if proof.port == "torque_command"] == [
        f"{side}/torque_limiter" for side in SIDES
    ]


def test_run_ends_without_fault(walked):
    assert (walked.outcome.status, walked.outcome.unconfirmed, walked.outcome.unanswered) == ("ok", (), ())


@pytest.mark.parametrize("side", SIDES)
def test_thigh_pitch_equals_hip_position(walked, side):
    """Both sample at 200 Hz, up to a tick apart: at 2.2 rad/s that is 0.011 rad, and a code of the drive is 0.0004."""
    pitch, angle = steady(walked, f"{side}/thigh_imu.euler[1]"), steady(walked, f"{side}/hip.position")
    assert np.max(np.abs(pitch - angle)) < 0.0125 and 0.6 < np.ptp(pitch) < 0.9


@pytest.mark.parametrize("side", SIDES)
def test_assistance_power_is_positive(walked, side):
    power = steady(walked, f"{side}/hip.torque") * steady(walked, f"{side}/hip.velocity")
    assert power.mean() > 2.0 and power.clip(max=0.0).sum() > -0.02 * power.clip(min=0.0).sum()


def test_the_hips_are_assisted_in_opposite_directions(walked):
    left, right = (steady(walked, f"{side}/torque_limiter.limited") for side in SIDES)
    np.testing.assert_allclose(left, -right, atol=1e-12)
    assert 2.0 < np.max(np.abs(left)) <= 6.0


def test_standing_legs_get_no_torque():
    trial = runtime.run(HIP_EXO, 10.0, settings={"speed": "0:1.2 6:1.2 8:0"})
    torque = np.abs(trial["left/torque_limiter.limited"])
    assert torque[(trial.time > 3.0) & (trial.time < 6.0)].max() > 2.0
    assert torque[trial.time > 8.3].max() == 0.0
