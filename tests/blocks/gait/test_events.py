"""Heel strikes from ground contact, shank, thigh and knee."""

import csv
import math

import numpy as np
import pytest

from blocks.gait import ContactEvents, GyroEvents, KneeEvents, ThighEvents
from blocks.wearer import SoleForce, Walker
from graph import Diagram
from runtime.session.simulate import simulate
from runtime.setup.bench.gait import play
from runtime.setup.bench.gait_recordings import built_in
from tests.blocks.gait.walks import RATE, vertical_force
from tests.blocks.running import both_ways, inside
from tests.shared import shared

WALK = play(built_in()[0], "steady", RATE)
DETECTORS = {
    "gyro": (GyroEvents, {"velocity": "shank_velocity"}),
    "thigh": (ThighEvents, {"angle": "thigh"}),
    "knee": (KneeEvents, {"angle": "knee", "velocity": "knee_velocity"}),
}
FOOT = ("ground_force", "centre_of_pressure", "phase")


def late(outputs, strikes, begin=4.0, rate=RATE):
    """Delay in s of each estimate after its true strike; every strike after `begin` has one estimate."""
    times = np.flatnonzero(outputs["strike"] == 1.0) / rate
    times, strikes = times[times > begin - 0.3], strikes[strikes > begin]
    delays = [times[np.argmin(np.abs(times - strike))] - strike for strike in strikes]
    between = times[(times > strikes[0] - 0.3) & (times < strikes[-1] + 0.3)]
    assert len(between) == len(strikes) and np.abs(delays).max() < 0.3
    return np.array(delays)


def dropped(force, share, seed):
    return np.where(np.random.default_rng(seed).random(len(force)) < share, 0.0, force)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_contact_loses_no_strike_at_a_tenth_of_the_force_with_drift_and_drop_outs(seed, scale):
    random = np.random.default_rng(seed)
    force, strikes = vertical_force(1.1 + 0.03 * random.normal(size=40))
    drift = np.linspace(0.0, 60.0, len(force))
    for zero in (drift, 60.0, -drift):
        outputs = inside(ContactEvents, force=dropped(scale * force + zero, 0.02, seed))
        assert np.median(np.abs(late(outputs, strikes))) < 0.015


def test_contact_may_begin_in_stance_with_any_zero():
    force, strikes = vertical_force(np.full(12, 1.1))
    for zero in (0.0, 60.0, -60.0):
        late(inside(ContactEvents, force=force[40:] + zero), strikes - 0.2)


def test_contact_recovers_from_a_jump_of_its_zero_and_holds_during_standing():
    force, strikes = vertical_force(np.full(30, 1.1))
    jumped = 0.1 * force + np.where(np.arange(len(force)) > 10 * 220, 60.0, 0.0)
    late(inside(ContactEvents, force=jumped), strikes, begin=10 * 1.1 + 4.0)
    standing = np.concatenate((force, np.full(2000, 400.0), force))
    outputs = inside(ContactEvents, force=standing)
    assert outputs["contact"][len(force) + 100 : len(force) + 1900].all()
    assert outputs["strides"][len(force) + 1990] - outputs["strides"][len(force) - 1] <= 1


def test_contact_follows_the_recorded_force_of_a_treadmill():
    with open(shared("gait/series_vertical_grf_moore2015.csv"), newline="") as file:
        force = np.array([float(row["grf_vertical_N"]) for row in csv.DictReader(file)])
    loaded = force > 40.0
    true = (np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1) / 100.0
    true = true[np.concatenate(([True], np.diff(true) > 0.5))]
    for scale, zero in ((1.0, 0.0), (0.1, 60.0)):
        outputs = inside(ContactEvents, rate=100, force=dropped(scale * force + zero, 0.02, 1))
        assert np.median(np.abs(late(outputs, true, rate=100.0))) <= 0.02


@pytest.mark.parametrize("name", DETECTORS)
def test_every_strike_of_steady_walking_is_detected_once_at_any_amplitude(name):
    block, inputs = DETECTORS[name]
    for scale in (1.0, 0.6, 1.3):
        outputs = inside(block, **{port: scale * WALK.signals[signal] for port, signal in inputs.items()})
        delays = late(outputs, WALK.strikes)
        assert np.median(np.abs(delays)) < 0.016 and np.abs(delays).max() < 0.06


@pytest.mark.parametrize("name", DETECTORS)
def test_outliers_of_one_sample_lose_and_invent_no_strike(name):
    """Of each signal 0.4 % of the samples are off by 1 rad, or 15 rad/s."""
    block, inputs = DETECTORS[name]
    random, signals = np.random.default_rng(3), {}
    for port, signal in inputs.items():
        values = WALK.signals[signal]
        size = 15.0 if signal.endswith("velocity") else 1.0
        outliers = np.diff((random.random(len(values) + 1) < 0.004).astype(int)) > 0  # no two in a row
        signals[port] = values + size * outliers * random.choice([-1.0, 1.0], len(values))
    delays = late(inside(block, **signals), WALK.strikes)
    assert np.median(np.abs(delays)) < 0.016 and np.abs(delays).max() < 0.06


def test_a_thigh_sensor_that_slips_by_20_degrees_loses_at_most_two_strikes():
    for slip in (0.35, -0.35):
        begin = WALK.strikes[20] + 0.3
        outputs = inside(ThighEvents, angle=WALK.signals["thigh"] + np.where(WALK.time > begin, slip, 0.0))
        late(outputs, WALK.strikes, begin=WALK.strikes[23] - 0.2)
        assert outputs["strides"][round(WALK.strikes[22] * RATE) + 20] >= 20


def test_an_outlier_in_swing_is_no_contact():
    force, strikes = vertical_force(np.full(12, 1.1))
    force[np.round((strikes[5:9] + 0.85) * RATE).astype(int)] = 700.0
    assert np.abs(late(inside(ContactEvents, force=force), strikes)).max() < 0.02


def test_feet_that_touch_the_ground_in_a_seat_do_not_step():
    force, strikes = vertical_force(np.full(12, 1.1))
    touching = 60.0 + 45.0 * np.sin(2.0 * np.pi * 0.9 * np.arange(4000) / RATE)
    outputs = inside(ContactEvents, force=np.concatenate((force, touching, force)))
    steps = np.diff(outputs["strides"][[len(force), len(force) + 3990, len(outputs["strides"]) - 1]])
    assert steps[0] <= 1 and steps[1] >= 10


def test_a_knee_that_swings_as_a_pendulum_does_not_step():
    """After four strides, both phases of 0.8 to 1.1 Hz for 20 s, as of legs that hang from a seat."""
    walk = WALK.signals["knee"][:1000]
    for frequency in (0.8, 1.1):
        swing = 0.6 + 0.5 * np.sin(2.0 * np.pi * frequency * np.arange(4000) / RATE)
        angle = np.concatenate((walk, swing))
        strike = inside(KneeEvents, angle=angle, velocity=np.gradient(angle, 1.0 / RATE))["strike"]
        assert strike[:1000].sum() >= 3 and strike[1400:].sum() <= 1


@pytest.mark.parametrize("speed, person", [(0.2, 8), (0.6, 0), (1.2, 3), (1.6, 0), (1.95, 10)])
def test_a_gyroscope_that_is_mounted_upside_down_detects_at_most_three_strikes(speed, person):
    with Diagram("walk", RATE) as diagram:
        Walker(speed, person=person, name="walker")
    rate = simulate(diagram, 40.0)["walker.left_shank_motion[7]"]
    strike = inside(GyroEvents, velocity=-rate)["strike"]
    assert strike.sum() <= 3 and not strike[int(6.0 * RATE) :].any()
    assert inside(GyroEvents, velocity=rate)["strike"].sum() >= 17


def test_a_knee_that_flexes_in_stance_half_as_far_as_in_swing_has_one_strike_a_stride():
    phase = np.arange(20 * 140) / 140.0
    bumps = [np.exp(-0.5 * ((phase % 1.0 - centre) / width) ** 2) for centre, width in ((0.14, 0.06), (0.73, 0.09))]
    angle = 0.6 * bumps[0] + 1.1 * bumps[1]
    outputs = inside(KneeEvents, angle=angle, velocity=np.gradient(angle, 1.0 / RATE))
    at = np.flatnonzero(outputs["strike"][560:]) % 140
    assert len(at) == 16 and at.min() > 120


@pytest.mark.parametrize("share", [0.08, 0.12, 0.15])
def test_the_time_from_the_extension_of_a_knee_to_the_strike_is_learned(share):
    """The extension decelerates in the last `share` of a stride: the event is in the middle of that."""
    time = np.arange(0.0, 33.0, 1.0 / RATE)
    phase = time / 1.1 % 1.0
    knots = (0.0, 0.02, 0.08, 0.14, 0.3, 0.48, 0.6, 0.7, 1.0 - share)
    velocity = np.interp(phase, knots, (0.0, -0.3, 3.0, 0.0, -0.9, 0.0, 9.0, 0.0, -7.0))
    velocity = np.where(phase > knots[-1], -3.5 + 3.5 * np.cos(np.pi * (1.0 - phase) / share), velocity)
    forward = phase < 0.7
    velocity = np.where(forward, velocity, velocity * velocity[forward].sum() / -velocity[~forward].sum())
    noise = np.random.default_rng(0).normal(size=(2, len(time)))
    outputs = inside(KneeEvents, angle=np.cumsum(velocity) / RATE + 0.01 * noise[0], velocity=velocity + 0.1 * noise[1])
    assert np.abs(np.mean(late(outputs, np.arange(1.1, 32.0, 1.1), begin=7.0))) < 0.01


@pytest.mark.parametrize("side", ["lt", "rt"])
def test_the_learned_time_is_that_of_a_recorded_adult(side):
    with open(shared("gait/healthy_young.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    knee = np.radians([float(row[f"knee_flexion_{side}_deg"]) for row in rows])
    loaded = np.array([float(row[f"contact_{side}"]) for row in rows]) > 500.0
    strikes = (np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1) / RATE
    outputs = inside(KneeEvents, angle=knee, velocity=np.gradient(knee, 1.0 / RATE))
    assert abs(np.mean(late(outputs, strikes[strikes < 49.0], begin=6.0))) < 0.006


@pytest.mark.parametrize("name", DETECTORS)
def test_stepped_by_hand_it_is_the_block_of_a_diagram(name):
    block, inputs = DETECTORS[name]
    both_ways(block, **{port: WALK.signals[signal][:1200] for port, signal in inputs.items()})


@pytest.mark.hazard("H12c")
@pytest.mark.parametrize("name", DETECTORS)
def test_a_missing_sample_gives_nan_and_is_not_stored(name):
    block, inputs = DETECTORS[name]
    signals = {port: WALK.signals[signal][:2400].copy() for port, signal in inputs.items()}
    clean = inside(block, **signals)
    for values in signals.values():
        values[1500] = math.nan
    outputs = inside(block, **signals)
    assert math.isnan(outputs["strike"][1500]) and math.isnan(outputs["elapsed"][1500])
    assert outputs["strides"][-1] == clean["strides"][-1]


@pytest.mark.parametrize("name", DETECTORS)
def test_a_strike_that_is_due_at_missing_samples_is_reported_after_them(name):
    block, inputs = DETECTORS[name]
    signals = {port: WALK.signals[signal][:2400].copy() for port, signal in inputs.items()}
    strike = int(np.flatnonzero(inside(block, **signals)["strike"])[7])
    for values in signals.values():
        values[strike : strike + 2] = math.nan
    outputs = inside(block, **signals)
    assert np.isnan(outputs["strike"][strike : strike + 2]).all() and outputs["strike"][strike + 2] == 1.0
    assert np.nansum(outputs["strike"]) == outputs["strides"][-1]


@pytest.mark.parametrize("speed, person", [(0.6, 29), (0.8, 13), (1.0, 12), (1.6, 18), (1.9, 3)])
def test_a_sensor_under_the_heel_alone_reports_each_strike_of_a_walker_whose_heel_presses_again(speed, person):
    """0.1 to 0.2 s after it has left the ground, by 10 to 20 % of the load."""
    with Diagram("walk", RATE) as diagram:
        walker = Walker(speed, person=person, name="walker")()
        foot = {port: getattr(walker, f"left_{port}") for port in FOOT}
        ContactEvents(smallest=10.0, name="events")(SoleForce(gain=0.1)(**foot).heel)
    trial = simulate(diagram, 30.0)
    strikes = trial.time[np.flatnonzero(np.diff(trial["walker.left_phase"]) < -0.5)]
    outputs = {"strike": trial["events.strike"]}
    assert np.abs(late(outputs, strikes[strikes < 29.0])).max() < 0.06


@pytest.mark.parametrize("pause", [0.08, 0.13])
def test_a_heel_that_presses_again_before_it_leaves_the_ground_loses_no_strike(pause):
    """The load under a heel falls below the threshold in mid-stance, and rises to a fifth before the swing."""
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    phase, begin = time % 1.0, 0.25 + pause
    force = np.where(phase < 0.25, 40.0 * np.sin(np.pi * phase / 0.25), 0.0)
    force += np.where((phase > begin) & (phase < begin + 0.1), 8.0 * np.sin(np.pi * (phase - begin) / 0.1), 0.0)
    force[time < 2.6] = np.where(time[time < 2.6] < 2.3, 15.0, 0.0)  # it stands, and swings
    outputs = inside(lambda: ContactEvents(smallest=10.0), force=force)
    assert np.abs(late(outputs, np.arange(3.0, 20.0))).max() < 0.02
