"""Gait phase: from time since strike, phase portrait, oscillators and Kalman filter."""

import math

import numpy as np
import pytest

from blocks.gait import (
    AdaptiveOscillator,
    CirclePhase,
    ContactEvents,
    GaitPhase,
    KneeEvents,
    PhaseKalmanFilter,
    PhasePortrait,
    StridePhase,
)
from blocks.wearer import Walker
from graph import Diagram
from runtime.session.simulate import simulate
from runtime.setup.bench.gait import Leg, begins, play
from runtime.setup.bench.gait_recordings import built_in
from tests.blocks.gait.walks import RATE
from tests.blocks.running import both_ways, inside
from tests.soaking import soaked

LEG = built_in()[0]


def walk(condition="steady", start=0.0):
    """(walk, strike for each tick), with the true strikes. start : s, from which the leg is played"""
    later = LEG.time >= start
    angles = {name: angle[later] for name, angle in LEG.angles.items()}
    played = play(Leg(LEG.name, LEG.time[later], angles, LEG.contact[later]), condition, RATE)
    strike = np.zeros(len(played.time), dtype=bool)
    strike[np.round(played.strikes * RATE).astype(int)] = True
    return played, strike


def inputs(block, played, strike, scale=1.0, segment="thigh"):
    signals = {"strike": strike}
    if block is not StridePhase:
        signals["angle"] = scale * played.signals[segment]
    if block in (PhasePortrait, PhaseKalmanFilter):
        signals["velocity"] = scale * played.signals[f"{segment}_velocity"]
    return signals


def error(outputs, played, begin=14.0):
    """RMS of the phase error in % of a stride."""
    chosen = (played.time > begin) & np.isfinite(played.phase) & played.moving
    difference = (outputs["phase"] - played.phase + 0.5)[chosen] % 1.0 - 0.5
    return 100.0 * np.sqrt(np.mean(difference**2))


@pytest.mark.parametrize(
    "block, condition, bound",
    [
        (StridePhase, "steady", 1.5),
        (AdaptiveOscillator, "steady", 1.5),
        (AdaptiveOscillator, "sine", 3.0),
        (AdaptiveOscillator, "stops", 9.0),
        (PhaseKalmanFilter, "steady", 1.0),
        (PhaseKalmanFilter, "sine", 1.5),
        (PhaseKalmanFilter, "steps", 2.5),
        (PhaseKalmanFilter, "stops", 1.5),
    ],
)
def test_phase_error(block, condition, bound):
    played, strike = walk(condition)
    outputs = inside(block, **inputs(block, played, strike))
    assert error(outputs, played) < bound


@pytest.mark.parametrize("scale", [0.6, -1.0])
def test_the_kalman_filter_learns_any_amplitude_and_sign(scale):
    played, strike = walk("sine")
    outputs = inside(PhaseKalmanFilter, **inputs(PhaseKalmanFilter, played, strike, scale))
    assert error(outputs, played) < 1.5


def test_the_kalman_filter_holds_its_phase_while_the_leg_stands():
    played, strike = walk("stops")
    outputs = inside(PhaseKalmanFilter, **inputs(PhaseKalmanFilter, played, strike))
    still = np.flatnonzero((played.signals["thigh_velocity"] == 0.0) & (played.time > 14.0))
    later = still[np.isin(still - 60, still)]  # 0.3 s after it has stopped
    assert len(later) > 500 and not outputs["walking"][later].any()
    assert np.abs(outputs["frequency"][later]).max() < 0.25


@pytest.mark.parametrize(
    "segment, start, bound", [("knee", 0.0, 1.0), ("knee", 0.8, 2.5), ("shank", 0.4, 1.0), ("thigh", 0.2, 1.5)]
)
def test_after_a_stand_the_phase_continues_where_the_leg_came_to_rest(segment, start, bound):
    """The angle at which a leg stands belongs to several phases."""
    played, strike = walk("stops", start)
    outputs = inside(PhaseKalmanFilter, **inputs(PhaseKalmanFilter, played, strike, segment=segment))
    assert error(outputs, played) < bound
    stands = (played.time > 14.0) & (played.time % 10.0 > 8.7) & (played.time % 10.0 < 9.6)
    assert not outputs["walking"][stands].any()


@pytest.mark.parametrize("speed, share", soaked([(0.2, 0.92), (0.3, 0.96), (0.4, 1.0)], but=[0]))
def test_the_kalman_filter_walks_with_strides_of_two_seconds(speed, share):
    """Its frequency varies within a stride, down to half of the cadence, here of 0.45 to 0.55 Hz."""
    for seed in range(3):
        with Diagram("slow", RATE) as diagram:
            Walker(speed, seed=seed, name="walker")
        trial = simulate(diagram, 60.0)
        phase, angle, velocity = (trial[f"walker.left_{name}"] for name in ("phase", "thigh_pitch", "thigh_motion[7]"))
        strike = np.concatenate(([False], phase[1:] < phase[:-1] - 0.5))
        outputs = inside(PhaseKalmanFilter, angle=angle, velocity=velocity, strike=strike)
        assert outputs["walking"][trial.time > 15.0].mean() >= share


SPEEDS = "0:0.9 16:0.9 17:0 19:0 20:1.3 26:1.3 28:0.6 32:0.6 33:0 36:0 37:0.9 45:0.9"  # m/s


@pytest.mark.parametrize("angle", ["thigh", "knee"])
def test_every_strike_of_a_walker_that_stops_begins_one_stride_of_the_kalman_filter(angle):
    with Diagram("walk", 100) as diagram:
        motion = Walker(SPEEDS, seed=2, name="walker")()
        if angle == "thigh":
            flexion, velocity = motion.left_thigh_pitch, motion.left_thigh_motion[7]
            strike = ContactEvents()(force=motion.left_ground_force[1]).strike
        else:
            flexion, velocity = motion.left_knee_angle, motion.left_knee_velocity
            strike = KneeEvents()(angle=flexion, velocity=velocity).strike
        PhaseKalmanFilter(name="filter")(angle=flexion, velocity=velocity, strike=strike)
    trial = simulate(diagram, 45.0)
    contact = trial["walker.left_contact"]
    true = trial.time[1:][contact[1:] > contact[:-1]]
    estimates = trial.time[begins(trial["filter.phase"], trial["filter.walking"])]

    def walked(times):
        """Times after two strides, one per stride, without those at which a standing foot shifts its load."""
        return [t for t in times[np.diff(times, prepend=0.0) > 0.6] if 8.2 < t < 43.9 and not 17.0 < t < 19.5]

    true, estimates = walked(true), np.array(walked(estimates))
    late = [np.abs(estimates - strike).min() for strike in true]
    assert len(estimates) == len(true) == 22 and np.median(late) < 0.02 and max(late) < 0.15


@pytest.mark.parametrize("block", [StridePhase, PhasePortrait, AdaptiveOscillator, PhaseKalmanFilter])
def test_stepped_by_hand_it_is_the_block_of_a_diagram(block):
    played, strike = walk()
    both_ways(block, **{name: values[:1600] for name, values in inputs(block, played, strike).items()})


@pytest.mark.hazard("H12c")
@pytest.mark.parametrize("block", [PhasePortrait, AdaptiveOscillator, PhaseKalmanFilter])
def test_a_missing_sample_gives_nan_and_is_not_stored(block):
    played, strike = walk()
    signals = inputs(block, played, strike)
    signals["angle"] = signals["angle"].copy()
    signals["angle"][3003] = math.nan
    outputs = inside(block, **signals)
    assert math.isnan(outputs["phase"][3003]) and np.isfinite(outputs["phase"][3004:]).all()
    outputs["phase"][3003] = played.phase[3003]
    assert error(outputs, played) < 9.0


def test_time_since_strike_starts_again_after_a_stop():
    strike = np.zeros(2400, dtype=bool)
    strike[[100, 320, 540, 760, 1700, 1920, 2140]] = True
    outputs = inside(StridePhase, strike=strike)
    walking = np.flatnonzero(np.diff(outputs["walking"]))
    assert list(walking + 1) == [540, 760 + 331, 2140]
    assert outputs["phase"][650] == pytest.approx(0.5, abs=0.001)


def test_kalman_filter_walks_again_within_two_strides_of_a_sensor_that_slips_by_20_degrees():
    played, strike = walk()
    slip = played.strikes[20] + 0.3
    angle = played.signals["thigh"] + np.where(played.time > slip, 0.35, 0.0)
    outputs = inside(PhaseKalmanFilter, angle=angle, velocity=played.signals["thigh_velocity"], strike=strike)
    assert outputs["walking"][played.time > played.strikes[23]].all()
    assert error(outputs, played, begin=played.strikes[24]) < 2.0


def test_oscillators_that_start_far_from_the_walk_follow_it_after_a_few_strides():
    """The thigh is 1.4 rad higher in a seat of 8 s, from which the walk starts in 1 s."""
    played, strike = walk()
    count = len(played.time)
    share = np.clip(np.arange(count + 1600) / RATE - 7.0, 0.0, 1.0)
    thigh = np.concatenate((np.full(1600, played.signals["thigh"][0]), played.signals["thigh"]))
    angle = 1.4 * (1.0 - share) + share * thigh
    strikes = np.concatenate((np.zeros(1600, dtype=bool), strike))
    outputs = inside(AdaptiveOscillator, angle=angle, strike=strikes)
    late = {name: values[1600:] for name, values in outputs.items()}
    assert error(late, played, begin=20.0) < 2.0 and late["walking"][played.time > 15.0].all()


def test_the_uncertainty_is_the_spread_of_the_last_strikes():
    """Strikes scatter with a standard deviation of 4 % of a stride from the thirtieth on, and are half a stride late
    from the fiftieth on.
    """
    played, _ = walk()
    stride = np.diff(played.strikes)[0]
    number = np.arange(len(played.strikes))
    scatter = 0.04 * stride * np.random.default_rng(1).normal(size=len(number))
    times = played.strikes + np.where(number < 30, 0.0, scatter) + np.where(number < 50, 0.0, 0.5 * stride)
    times = times[times < played.time[-1]]
    strike = np.zeros(len(played.time), dtype=bool)
    strike[np.round(times * RATE).astype(int)] = True
    for block in (StridePhase, PhaseKalmanFilter):
        outputs = inside(block, **inputs(block, played, strike))
        at = np.round(times * RATE).astype(int) - 1  # just before each strike
        u = outputs["uncertainty"][at]
        assert np.all(u[:2] > 0.28) and np.all(u[12:30] < 0.03), block
        assert 0.02 < np.median(u[40:50]) < 0.09 and u[52] > 0.1, block
    more = inside(lambda: PhaseKalmanFilter(strike_offset=0.2), **inputs(PhaseKalmanFilter, played, strike))
    np.testing.assert_allclose(more["uncertainty"], np.minimum(12**-0.5, np.hypot(outputs["uncertainty"], 0.2)), 1e-12)


def test_oscillators_do_not_walk_from_a_strike_that_contradicts_their_phase():
    """From the thirtieth strike on, strikes are half a stride late; the phase has adapted after ten of them."""
    played, strike = walk()
    times = played.strikes + np.where(np.arange(len(played.strikes)) < 30, 0.0, 0.5 * np.diff(played.strikes)[0])
    late = np.zeros(len(played.time), dtype=bool)
    late[np.round(times[times < played.time[-1]] * RATE).astype(int)] = True
    walking = inside(AdaptiveOscillator, angle=played.signals["thigh"], strike=late)["walking"]
    at = {number: round(times[number] * RATE) for number in (20, 30, 31, 42)}
    assert walking[at[20] : at[30]].all() and not walking[at[30] : at[31]].any() and walking[at[42] :].all()


def test_the_length_of_a_mean_phase_is_its_uncertainty():
    """Means of the cosine and sine of phases with a normal spread; zeros in standing."""
    random = np.random.default_rng(1)
    phase, spreads = np.arange(2000) / RATE % 1.0, np.repeat([0.01, 0.05, 0.1, 0.15, 0.0], 400)
    turns = 2.0 * np.pi * (phase + spreads * random.normal(size=(20000, 1)))
    cosine, sine = np.cos(turns).mean(axis=0), np.sin(turns).mean(axis=0)
    cosine[1600:] = sine[1600:] = 0.0
    outputs = both_ways(CirclePhase, cosine=cosine, sine=sine)
    assert np.abs((outputs["phase"] - phase + 0.5)[:1600] % 1.0 - 0.5).max() < 0.01
    for begin in range(0, 1600, 400):
        assert outputs["uncertainty"][begin + 399] == pytest.approx(spreads[begin], rel=0.1)
    assert outputs["walking"][:1600].all() and not outputs["walking"][1600:].any()
    assert (outputs["uncertainty"][1600:] == math.sqrt(1.0 / 12.0)).all()


@pytest.mark.parametrize("spread", [0.0, 0.04, 0.07])
def test_the_uncertainty_of_a_phase_from_the_knee_is_the_spread_of_its_strides(spread):
    """Then the knee stops in stance: a swing that is overdue makes the phase uncertain."""
    random = np.random.default_rng(2)
    strides = np.cumsum(1.1 * (1.0 + spread * np.clip(random.normal(size=60), -2.0, 2.0)))
    time = np.arange(0.0, strides[-1] + 1.5, 1.0 / RATE)
    turns = np.interp(time, np.concatenate(([0.0], strides)), np.arange(61.0))
    angle = 0.55 - 0.5 * np.cos(2.0 * np.pi * turns)
    outputs = both_ways(GaitPhase, angle=angle, velocity=np.gradient(angle, 1.0 / RATE))
    late = (time > 20.0) & (time < strides[-1])
    usual = outputs["uncertainty"][late]
    assert np.sqrt(np.mean(usual**2)) == pytest.approx(1.1 * spread, abs=0.01 + 0.4 * spread)
    events = np.flatnonzero(np.diff(outputs["strides"]))
    overdue = outputs["uncertainty"][(time > time[events[-1]] + 1.25 * 1.1) & (time < time[events[-1]] + 1.45 * 1.1)]
    assert len(overdue) and overdue.min() > 0.2 - 2.0 * spread
    assert not outputs["walking"][-1] and outputs["uncertainty"][-1] == pytest.approx(0.2887, abs=1e-4)
