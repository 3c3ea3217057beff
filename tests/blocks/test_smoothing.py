"""Exponential, median and complementary filters: against closed forms, SciPy and plain Python."""

import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks.filters import Complementary, Exponential, Median
from graph import DiagramError, Interval
from tests.blocks.playing import made, play

RATE = 200.0
NOISE = np.random.default_rng(12).normal(0.0, 2.0, 500)
numbers = st.floats(-1e300, 1e300)


@pytest.mark.parametrize("time_constant", [1e-4, 0.01, 0.5, 30.0])
def test_an_exponential_is_the_recursion_to_the_bit_and_scipys_filter(time_constant):
    y = play(lambda: Exponential(time_constant), RATE, u=NOISE)["y"]
    dt, state, wanted = 1.0 / RATE, NOISE[0], []
    for u in NOISE:
        state = state + dt / (time_constant + dt) * (u - state)
        wanted.append(state)
    share = dt / (time_constant + dt)
    assert np.array_equal(y, wanted)
    assert (
        np.abs(y - signal.lfilter([share], [1.0, share - 1.0], NOISE, zi=[(1.0 - share) * NOISE[0]])[0]).max() < 1e-12
    )


def test_a_step_reaches_63_percent_after_the_time_constant():
    y = play(lambda: Exponential(1.0), 1000.0, u=np.r_[0.0, np.ones(1000)])["y"]
    assert abs(y[1000] - (1.0 - math.exp(-1.0))) < 1e-3


@given(u=st.lists(numbers, min_size=1, max_size=30), time_constant=st.floats(1e-12, 1e6))
def test_an_exponential_never_leaves_the_interval_of_its_inputs(u, time_constant):
    """Exactly, also where rounding would carry it past."""
    block = made(Exponential, time_constant)
    found = block.output_range(u=Interval(min(u), max(u)))
    assert found == Interval(min(u), max(u)) and all(block.step(x) in found for x in u)


def test_nan_passes_an_exponential_and_is_not_held():
    block = made(Exponential, 0.1)
    assert (
        math.isnan(block.step(math.nan))
        and block.step(4.0) == 4.0
        and math.isnan(block.step(math.nan))
        and block.step(4.0) == 4.0
    )


@pytest.mark.parametrize("samples", [1, 3, 5, 21])
def test_a_median_is_that_of_the_last_inputs_and_scipys_behind_the_start(samples):
    u = np.round(NOISE, 1)  # with equals among them
    y = play(lambda: Median(samples), RATE, u=u)["y"]
    for k in range(len(u)):
        assert y[k] == statistics.median(u[max(0, k - samples + 1) : k + 1])
    centred = signal.medfilt(u, samples)
    half = samples // 2
    assert np.array_equal(y[2 * half :], centred[half : len(u) - half])


def test_a_median_removes_a_single_outlier_and_keeps_edges():
    u = np.array([1.0, 1.0, 1.0, 99.0, 1.0, 1.0, 5.0, 5.0, 5.0])
    assert play(lambda: Median(3), RATE, u=u)["y"].tolist() == [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0, 5.0]


@given(
    u=st.lists(st.one_of(numbers, st.just(math.nan)), min_size=1, max_size=40), samples=st.sampled_from([1, 3, 5, 9])
)
def test_a_median_shows_nan_while_it_is_in_the_window_and_stays_in_the_range_of_its_inputs(u, samples):
    block = made(Median, samples)
    finite = [x for x in u if x == x] or [0.0]
    found = block.output_range(u=Interval(min(finite), max(finite)))
    for k, x in enumerate(u):
        y = block.step(x)
        window = u[max(0, k - samples + 1) : k + 1]
        if any(v != v for v in window):
            assert math.isnan(y)
        else:
            ordered = sorted(window)
            low, high = ordered[(len(window) - 1) // 2], ordered[len(window) // 2]
            assert low <= y <= high and y in found


def test_median_is_elementwise():
    u = np.array([[1.0, math.nan], [5.0, 2.0], [3.0, 4.0], [2.0, 6.0]])
    y = play(lambda: Median(3), RATE, u=u)["y"]
    assert np.array_equal(y, [[1.0, math.nan], [3.0, math.nan], [3.0, math.nan], [3.0, 4.0]], equal_nan=True)


def test_an_even_median_is_refused():
    with pytest.raises(DiagramError, match="samples: must be odd, got 4"):
        Median(4)


@pytest.mark.parametrize("time_constant", [0.02, 0.5, 5.0])
def test_a_complementary_filter_is_a_low_pass_of_the_angle_and_a_high_pass_of_the_gyroscope(time_constant):
    """Against SciPy: angle through 1 / (τ s + 1), rate through τ / (τ s + 1), both by backward differences."""
    rate, angle, dt = NOISE[:250].copy(), NOISE[250:].copy(), 1.0 / RATE
    angle[0] = rate[0] = 0.0
    y = play(lambda: Complementary(time_constant), RATE, rate=rate, angle=angle)["fused"]
    below = [1.0, -time_constant / (time_constant + dt)]
    share = dt / (time_constant + dt)
    wanted = signal.lfilter([share], below, angle) + signal.lfilter([time_constant * share], below, rate)
    assert np.abs(y - wanted).max() < 1e-12


def test_a_biased_gyroscope_offsets_the_angle_by_its_bias_times_the_time_constant():
    t = np.arange(4000) / RATE
    angle = 0.3 * np.sin(2.0 * math.pi * t)
    rate = np.diff(angle, prepend=angle[0]) * RATE
    fused = play(lambda: Complementary(0.5), RATE, rate=rate, angle=angle)["fused"]
    assert np.abs(fused - angle).max() < 1e-12
    fused = play(lambda: Complementary(0.5), RATE, rate=rate + 0.02, angle=angle)["fused"]
    assert abs((fused - angle)[-1] - 0.5 * 0.02) < 1e-9


@given(data=st.data(), time_constant=st.floats(1e-3, 1e3))
def test_a_complementary_filter_stays_inside_its_range(data, time_constant):
    block = made(Complementary, time_constant)
    spans = [sorted(data.draw(st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)))) for _ in range(2)]
    found = block.output_range(rate=Interval(*spans[0]), angle=Interval(*spans[1]))
    for _ in range(40):
        rate, angle = (data.draw(st.sampled_from(span)) for span in spans)
        assert block.step(rate, angle) in found


def test_the_worst_rate_comes_near_the_range_of_a_complementary_filter():
    found = made(Complementary, 0.1).output_range(rate=Interval(-3.0, 2.0), angle=Interval(-1.0, 1.0))
    y = play(lambda: Complementary(0.1), RATE, rate=np.full(2000, 2.0), angle=np.ones(2000))["fused"]
    assert (
        abs(found.high - 1.2) < 1e-12
        and abs(found.low + 1.3) < 1e-12
        and y.max() <= found.high
        and found.high - y[-1] < 1e-9
    )


def test_nan_in_rate_or_angle_passes_a_complementary_filter_and_is_not_held():
    block = made(Complementary, 0.5)
    assert math.isnan(block.step(math.nan, 1.0)) and block.step(0.0, 1.0) == 1.0
    assert math.isnan(block.step(0.0, math.nan)) and block.step(0.0, 1.0) == 1.0
