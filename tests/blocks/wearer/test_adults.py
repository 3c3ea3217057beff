"""Adults who differ from the average, against the standard deviations between measured adults."""

import numpy as np
import pytest

from blocks.wearer import Walker, walking_speed
from blocks.wearer.adults import family, scores_of
from blocks.wearer.mechanics import pitches_of
from blocks.wearer.norms import MOTIONS
from blocks.wearer.stride import values
from graph import Diagram, DiagramError
from tests.blocks.wearer.test_walker import walk

WALK = MOTIONS["walk"]
SEEDS = range(1, 41)


@pytest.fixture(scope="module")
def adults():
    """Series of drawn adults at 1.21 m/s."""
    return [family(WALK[1:2], seed)[0] for seed in SEEDS]


@pytest.mark.soak
def test_drawn_adults_have_the_standard_deviations_of_the_measured_ones(adults):
    """Of 40 adults, in the mean over the stride within 30 %; no knee extends beyond 8°."""
    angles = np.array([[values(curve) for curve in each["angles"]] for each in adults])
    for joint in range(3):
        ratio = angles[:, joint].std(axis=0) / values(WALK[1]["angle_deviations"][joint])
        assert 0.7 < ratio.mean() < 1.3 and ratio.min() > 0.5
    assert angles[:, 1].min() > np.radians(-8.0)
    assert 0.03 < np.std([each["stride_time"] / WALK[1]["stride_time"] for each in adults]) < 0.08
    torques = np.array([[values(curve) for curve in each["moments"]] for each in adults])
    assert np.all(torques.std(axis=0).mean(axis=1) < [0.2, 0.12, 0.08])  # N·m/kg


def test_foot_of_a_drawn_adult_is_flat_in_mid_stance(adults):
    """As far as that of the average adult within 4°."""

    def slope(entry):
        return np.degrees(np.ptp(pitches_of(0.0, [values(each) for each in entry["angles"]])[2][40:70]))

    assert max(map(slope, adults)) < slope(WALK[1]) + 4.0


def test_an_adult_is_the_same_at_every_speed_and_others_differ():
    slow, fast = (family(WALK[n : n + 1], 7)[0] for n in (0, 2))
    apart = [[values(b) - values(a) for a, b in zip(WALK[n]["angles"], e["angles"])] for n, e in ((0, slow), (2, fast))]
    assert all(np.corrcoef(*pair)[0, 1] > 0.9 for pair in zip(*apart))
    first, again, other, scored = (walk(0.5, rate=200, person=person) for person in (7, 7.0, 8, (0.0, 1.5)))
    assert np.array_equal(first["left_hip_angle"], again["left_hip_angle"])
    assert np.array_equal(scores_of("0 1.5"), scores_of((0.0, 1.5)))  # as from --set person="0 1.5"
    assert all(np.abs(first["left_hip_angle"] - each["left_hip_angle"]).max() > 0.02 for each in (other, scored))


def test_strides_of_an_adult_are_as_long_as_the_legs_make_them():
    """The loaded heel and ball slip by less than 3 cm, as those of the average adult do by 2 cm."""
    speed = walking_speed(1.1, person=7)
    trace = walk(2.4, rate=200, speed=speed, person=7, variability=0.0)
    strikes = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5) + 1
    assert np.diff(strikes)[0] / 200 == pytest.approx(1.1, abs=0.011)
    pitch, phase = trace["left_foot_pitch"], trace["left_phase"]
    for along, begin, end in ((-0.25, 0.03, 0.30), (0.47, 0.15, 0.50)):
        x = trace["left_foot_motion[0]"] + 1.7 * (along * 0.152 * np.cos(pitch) + 0.039 * np.sin(pitch))
        loaded = (np.arange(len(x)) >= strikes[0]) & (np.arange(len(x)) < strikes[1]) & (phase > begin) & (phase < end)
        assert np.ptp(x[loaded]) < 0.03


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"person": -1}, "person must be a whole number from 0 to 4294967295 or scores, got -1"),
        ({"person": 0.5}, "must be a whole number"),
        ({"person": "tall"}, "person must be a seed, or at most 36 scores from -5 to 5, got 'tall'"),
        ({"person": (0.0, 6.0)}, "at most 36 scores from -5 to 5"),
        (
            {"person": 3, "motion": "on_toes"},
            "motion 'on_toes' is that of the average adult only: leave person at 0, got 3",
        ),
    ],
)
def test_walker_rejects_persons_that_it_cannot_make(parameters, message):
    with Diagram("walk", rate=200), pytest.raises(DiagramError, match=message):
        Walker(**parameters)
