"""Gait phase from the knee: against a plain-Python oracle, the walking model, and the foot contacts of a recorded
person.
"""

import csv
import math

import numpy as np
import pytest

from blocks.controllers import GaitPhase
from graph import DiagramError, deg
from tests.blocks.running import both_ways, inside
from tests.shared import shared

RATE = 200.0
# Knee flexion in degrees at every 5 % of the stride of an adult at natural cadence, from heel strike. (Winter 1991)
KNEE_FLEXION = (4, 9, 15, 18, 17, 14, 11, 8, 6, 7, 12, 21, 35, 50, 60, 62, 56, 42, 24, 9)


class Oracle:
    """GaitPhase in plain Python: times of events instead of a running clock."""

    def __init__(self, threshold=0.7, event_phase=0.62, shortest=0.6, longest=2.5, dt=1.0 / RATE):
        self.threshold, self.event_phase, self.shortest, self.longest, self.dt = (
            threshold,
            event_phase,
            shortest,
            longest,
            dt,
        )
        self.tick, self.last, self.extended, self.events = 0, None, False, 0
        self.mean, self.swing, self.count = 0.0, None, 0  # of strides; the usual swing, once two strides agree

    def step(self, angle, velocity):
        self.tick += 1
        now = self.tick * self.dt
        since = math.inf if self.last is None else now - self.last
        if angle < 0.5 * self.threshold and not self.extended:
            self.extended = True
            if self.count == 2:
                self.swing = since if self.swing is None else self.swing + (since - self.swing) / 3.0
            elif self.count == 0 and self.swing is not None and abs(since - self.swing) < 0.4 * self.swing:
                self.count = 2
        if self.extended and angle > self.threshold and velocity > 0.0:
            self.extended = False
            if not self.shortest - 1e-9 <= since <= self.longest + 1e-9:
                self.count = 0
            elif self.count or (self.swing is not None and abs(since - self.mean) <= 0.25 * self.mean):
                self.mean, self.count = self.mean + (since - self.mean) / 3.0, 2
            else:
                self.mean, self.count, self.swing = since, 1, None
            self.events, self.last, since = self.events + 1, now, 0.0
        if since > self.longest + 1e-9 or (self.count and since > 1.5 * self.mean + 1e-9):
            self.last, self.count = None, 0
        known = self.count == 2
        phase = (self.event_phase + since / self.mean) % 1.0 if known else 0.0
        return phase, known, self.mean if known else 0.0, self.events


def walk(seconds, stride_time=1.1, start=0.0):
    """(angle, velocity) at RATE of a knee that follows the first six harmonics of KNEE_FLEXION."""
    k = np.arange(7)
    waves = np.fft.rfft(np.radians(KNEE_FLEXION))[:7] / len(KNEE_FLEXION) * np.where(k, 2.0, 1.0)
    phase = np.arange(int(seconds * RATE)) / RATE / stride_time + start
    turns = waves * np.exp(2j * np.pi * np.outer(phase, k))
    return turns.sum(axis=1).real, (2j * np.pi / stride_time * turns @ k).real


def estimate(angle, velocity, **parameters):
    return inside(lambda: GaitPhase(**parameters), rate=RATE, angle=np.asarray(angle), velocity=np.asarray(velocity))


def unlike(phase, wanted):
    """Difference of two phases, the shorter way round."""
    return (phase - wanted + 0.5) % 1.0 - 0.5


def agrees_with_the_oracle(angle, velocity, **parameters):
    found, oracle = estimate(angle, velocity, **parameters), Oracle(**parameters)
    wanted = np.array([oracle.step(*now) for now in zip(angle, velocity)])
    assert np.array_equal(found["strides"], wanted[:, 3]) and np.array_equal(found["walking"], wanted[:, 1])
    assert (
        np.abs(unlike(found["phase"], wanted[:, 0])).max() < 1e-9
        and np.abs(found["stride_time"] - wanted[:, 2]).max() < 1e-9
    )
    return found


def test_stepping_a_block_equals_running_it_in_a_diagram():
    angle, velocity = walk(5.0)
    assert both_ways(GaitPhase, angle=angle, velocity=velocity)["walking"].any()


def test_gait_phase_equals_the_oracle_on_a_walk_with_a_pause():
    pieces = [walk(7.0, 1.1), walk(8.0, 1.45), (np.full(700, 0.1), np.zeros(700)), walk(6.0, 0.9)]
    found = agrees_with_the_oracle(*(np.concatenate([piece[i] for piece in pieces]) for i in (0, 1)))
    assert found["strides"][-1] > 15 and 0.3 < found["walking"].mean() < 0.9


@pytest.mark.parametrize("seed", range(4))
def test_gait_phase_equals_the_oracle_on_random_knee_motion(seed):
    random = np.random.default_rng(seed)
    velocity = np.convolve(random.normal(0.0, 1.0, 4000), np.ones(40) / 5.0, "same")
    angle = 0.5 + 0.6 * np.sin(np.cumsum(velocity) / RATE * 3.0)
    found = agrees_with_the_oracle(angle, np.gradient(angle, 1.0 / RATE), shortest=0.2, longest=1.5, threshold=0.6)
    assert found["strides"][-1] >= 5


def test_walking_is_detected_at_third_event():
    """The time from the start to the first event is no stride, however long it is."""
    for start in (0.0, 0.3, 0.55, 0.7):
        found = estimate(*walk(5.0, 1.1, start=start))
        events = np.flatnonzero(np.diff(found["strides"], prepend=0.0))
        assert np.argmax(found["walking"]) == events[2] and not found["walking"][: events[2]].any()
        assert abs(found["stride_time"][events[2]] - 1.1) < 1.5 / RATE
        assert not found["phase"][: events[2]].any() and not found["stride_time"][: events[2]].any()


@pytest.mark.parametrize("stride_time", [0.8, 1.0, 1.1, 1.4, 2.0])
def test_phase_equals_that_of_the_walking_model(stride_time):
    """Within 1.5 % of a stride, of which 0.5 % is a tick: the model's knee passes 40° at 61.7 % of it, where 62 % is
    expected.
    """
    found = estimate(*walk(12.0, stride_time))
    known = found["walking"] > 0.0
    phase = np.arange(len(known)) / RATE / stride_time % 1.0
    assert np.abs(unlike(found["phase"], phase)[known]).max() < 0.015
    assert np.abs(found["stride_time"][known] - stride_time).max() < 2.0 / RATE and known[-1]
    assert found["strides"][-1] == pytest.approx(12.0 / stride_time, abs=1.0)


def test_gait_phase_ends_one_and_a_half_strides_after_the_last_event_and_resumes_with_the_first_swing():
    """Standing for 2 s is no stride of 2 s: the phase of the new walk is right before its first strike."""
    going, standing = walk(6.0), (np.full(400, 0.05), np.zeros(400))
    found = estimate(*(np.concatenate([going[i], standing[i], going[i]]) for i in (0, 1)))
    events = np.flatnonzero(np.diff(found["strides"], prepend=0.0))
    last = events[events < len(going[0])][-1]
    stopped = np.flatnonzero(np.diff(found["walking"]) < 0.0)[0] + 1
    assert abs((stopped - last) / RATE - 1.5 * 1.1) <= 2.0 / RATE
    begin = len(going[0]) + 400
    resumed = stopped + np.argmax(found["walking"][stopped:])
    assert events[events > begin][0] < resumed < begin + 1.1 * RATE
    phase = (np.arange(len(going[0])) / RATE / 1.1) % 1.0
    assert np.abs(unlike(found["phase"][resumed:], phase[resumed - begin :])).max() < 0.02


@pytest.mark.parametrize("bent_time, stride_time, start, strides", [(0.5, 1.1, 0.3, 1), (2.0, 1.6, 0.0, 3)])
def test_after_a_bend_of_the_knee_one_stride_of_the_last_cadence_or_two_of_another_continue_the_walk(
    bent_time, stride_time, start, strides
):
    going, other = walk(6.0), walk(8.0, stride_time, start)
    time = np.arange(0.0, 2.5 + bent_time, 1.0 / RATE)
    bent = np.interp(time, np.cumsum((0.0, 2.0, 0.25, bent_time, 0.25)), (0.05, 0.05, 1.2, 1.2, 0.05))
    found = estimate(*(np.concatenate(pieces) for pieces in zip(going, (bent, np.gradient(bent, 1.0 / RATE)), other)))
    bend = int(8.0 * RATE)
    events = np.flatnonzero(np.diff(found["strides"], prepend=0.0))
    events = events[events > bend]
    assert np.argmax(found["walking"][bend:]) + bend == events[strides] and not found["walking"][bend]


def test_bending_the_knee_while_sitting_does_not_count_as_walking():
    """Swings faster than the shortest stride, and slower than the longest, never give a phase."""
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    for period in (0.5, 3.0):
        angle = 0.6 - 0.6 * np.cos(2.0 * np.pi * t / period)
        found = estimate(angle, np.gradient(angle, 1.0 / RATE))
        assert found["strides"][-1] > 3 and not found["walking"].any() and not found["phase"].any()


def test_a_knee_that_oscillates_about_the_threshold_counts_one_event_per_stride():
    angle, velocity = walk(12.0)
    tremble = 0.05 * np.sin(2.0 * np.pi * 12.0 * np.arange(len(angle)) / RATE)
    found = estimate(angle + tremble, velocity + np.gradient(tremble, 1.0 / RATE))
    assert found["strides"][-1] == estimate(angle, velocity)["strides"][-1]


def test_nan_passes_at_once_and_is_not_held():
    angle, velocity = walk(8.0)
    clean = estimate(angle, velocity)
    for signal, hole in ((angle, 1200), (velocity, 1240), (angle, 3)):
        kept = signal[hole]
        signal[hole] = math.nan
        found = estimate(angle, velocity)
        assert math.isnan(found["phase"][hole]) and found["walking"][hole] == 0.0
        for name in ("phase", "walking", "stride_time", "strides"):
            assert np.array_equal(np.delete(found[name], hole), np.delete(clean[name], hole)), name
        signal[hole] = kept


def test_the_phase_is_a_share_of_the_stride():
    for seed in range(3):
        noisy = [signal + np.random.default_rng(seed).normal(0.0, 0.05, 2400) for signal in walk(12.0)]
        found = estimate(*noisy)
        assert np.all((found["phase"] >= 0.0) & (found["phase"] <= 1.0)) and set(found["walking"]) <= {0.0, 1.0}


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"threshold": 0.0}, "threshold: must be above 0.0 rad"),
        ({"event_phase": 1.1}, "event_phase: must be at most 1.0, got 1.1"),
        ({"event_phase": -0.1}, "event_phase: must be at least 0.0"),
        ({"shortest": 0.0}, "shortest: must be above 0.0 s"),
        ({"shortest": 3.0}, r"shortest must be below longest \(2.5 s\), got 3 s"),
        ({"longest": math.nan}, "longest: NaN"),
    ],
)
def test_parameters_out_of_bounds_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=said):
        GaitPhase(**parameters)


@pytest.fixture(scope="module", params=["lt", "rt"])
def person(request):
    """(angle in rad, velocity, contact) of one leg of a healthy young adult, 50 s at 200 Hz; skipped where the shared
    room is absent.
    """
    with open(shared("gait/healthy_young.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    angle = np.radians([float(row[f"knee_flexion_{request.param}_deg"]) for row in rows])
    return (
        angle,
        np.gradient(angle, 1.0 / RATE),
        np.array([float(row[f"contact_{request.param}"]) for row in rows]) > 500.0,
    )


def edges(contact):
    """Ticks of heel strikes and of toe-offs."""
    change = np.diff(contact.astype(int), prepend=int(contact[0]))
    return np.flatnonzero(change > 0), np.flatnonzero(change < 0)


def test_on_recorded_walking_every_event_is_within_50_ms_of_toe_off_and_every_stride_is_counted(person):
    angle, velocity, contact = person
    _, toe_offs = edges(contact)
    found = estimate(angle, velocity)
    events = np.flatnonzero(np.diff(found["strides"], prepend=0.0))
    late = np.array([(event - toe_offs[np.argmin(np.abs(toe_offs - event))]) / RATE for event in events])
    assert len(events) == len(toe_offs) == 44
    assert np.abs(late).max() < 0.05 and abs(late.mean()) < 0.025


def test_on_recorded_walking_the_phase_at_heel_strike_is_zero_within_3_percent(person):
    angle, velocity, contact = person
    heel_strikes, _ = edges(contact)
    found = estimate(angle, velocity)
    known = heel_strikes[found["walking"][heel_strikes] > 0.0]
    error = unlike(found["phase"][known], 0.0)
    assert len(known) >= 41 and np.abs(error).max() < 0.03 and abs(error.mean()) < 0.01
    assert found["walking"][int(4.0 * RATE) :].all(), "and once it walks the phase is never lost"
    assert np.abs(found["stride_time"][found["walking"] > 0.0] - np.diff(heel_strikes).mean() / RATE).max() < 0.03


def test_on_recorded_walking_the_phase_rises_evenly(person):
    """From tick to tick by 1 / stride time, but for the correction at each event, which is at most 5 % of a stride."""
    found = estimate(*person[:2])
    known = found["walking"] > 0.0
    change = unlike(found["phase"][1:], found["phase"][:-1])[known[1:] & known[:-1]]
    assert change.max() < 0.05 and change.min() > -0.05
    assert np.median(change) == pytest.approx(1.0 / 1.127 / RATE, rel=0.02)


def test_on_recorded_walking_a_threshold_of_35_to_50_degrees_counts_the_same_strides(person):
    """But for one that has begun at an end of the recording."""
    for threshold in (deg(35.0), deg(45.0), deg(50.0)):
        assert abs(estimate(*person[:2], threshold=threshold)["strides"][-1] - 44) <= 1
