"""Limiters against plain Python, and what they promise: bounds that hold to the last bit, and what is not finite comes
out as NaN.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from graph import Diagram, DiagramError, Interval, Live
from tests.blocks.playing import settle
from tests.blocks.running import both_ways, by_hand

RATE = 200.0
anything = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(-1e6, 1e6)
sizes = st.floats(0.0, 1e6)


def limited(u, limit, slew=math.inf, dt=1.0 / RATE):
    """TorqueLimiter in plain Python."""
    previous, out = 0.0, []
    for x in u:
        target = math.nan if not math.isfinite(x) else min(max(x, -limit), limit)
        most = slew * dt
        y = previous + most if target - previous > most else previous - most if target - previous < -most else target
        if not math.isnan(y):
            previous = y
        out.append(y)
    return np.array(out)


def made(kind, **parameters):
    with Diagram("made", rate=RATE):
        return kind(**parameters)


NOISE = np.r_[0.0, np.random.default_rng(5).normal(0.0, 20.0, 300)]


@pytest.mark.parametrize(
    "limit, slew", [(12.0, 200.0), (12.0, math.inf), (0.0, 10.0), (9.0, 0.0), (1e-300, 1e9), (5.0, 1e4)]
)
def test_the_torque_limiter_equals_the_oracle_bit_for_bit(limit, slew):
    y = both_ways(lambda: TorqueLimiter(limit=limit, slew=slew), torque=NOISE)["limited"]
    assert np.array_equal(y, limited(NOISE, limit, slew))


@pytest.mark.hazard("H3c")
@given(u=st.lists(anything, min_size=1, max_size=40), limit=sizes, slew=st.one_of(sizes, st.just(math.inf)))
def test_a_torque_limiter_bounds_torque_and_slew_and_maps_non_finite_input_to_nan(u, limit, slew):
    """The bound holds exactly; the change within one rounding of the sum that makes it."""
    block = made(TorqueLimiter, limit=limit, slew=slew)
    previous, most = 0.0, slew / RATE
    for x, y in zip(u, by_hand(block, len(u), torque=u)["limited"]):
        assert math.isnan(y) == (not math.isfinite(x))
        if not math.isnan(y):
            assert abs(y) <= limit and y in block.output_range(torque=Interval())
            assert abs(y - previous) <= most + 2.0 * np.spacing(max(abs(y), abs(previous)))
            # Never past what was asked, and never away from it.
            target = min(max(x, -limit), limit)
            assert min(previous, target) <= y <= max(previous, target)
            previous = y


def test_a_torque_limiter_climbs_in_even_steps_and_stops_at_its_limit():
    y = by_hand(made(TorqueLimiter, limit=3.0, slew=200.0), 6, torque=[9.0] * 4 + [-9.0] * 2)["limited"]
    assert y.tolist() == [1.0, 2.0, 3.0, 3.0, 2.0, 1.0]


@pytest.mark.hazard("H2b")
def test_torque_limiter_maps_non_finite_input_to_nan_and_does_not_hold_it():
    u = np.array([0.0, 1.0, math.nan, math.nan, 1.0, math.inf, -math.inf, 1.0, 1e308])
    y = both_ways(lambda: TorqueLimiter(limit=12.0, slew=100.0), torque=u)["limited"]
    assert np.array_equal(y, [0.0, 0.5, math.nan, math.nan, 1.0, math.nan, math.nan, 1.0, 1.5], equal_nan=True)


def test_a_limit_lowered_during_the_run_applies_at_once():
    block = made(TorqueLimiter, limit=Live(12.0, max=15.0), slew=200.0)
    assert block.output_range(torque=Interval()) == Interval(-15.0, 15.0)
    for _ in range(12):
        high = block.step(12.0)
    block.limit = 4.0
    assert high == 12.0 and block.step(12.0) == 4.0 and block.step(-12.0) == 3.0
    block.limit = 15.0
    assert block.step(15.0) == 4.0, "a limit raised again is approached at the slew rate"


def test_without_a_slew_a_torque_limiter_crosses_its_whole_range_in_a_tenth_of_a_second():
    limited = by_hand(made(TorqueLimiter, limit=5.0), 60, torque=[5.0] * 20 + [-5.0] * 40)["limited"]
    np.testing.assert_allclose(limited[:10], 0.5 * np.arange(1, 11), rtol=0, atol=1e-12)
    np.testing.assert_allclose(limited[20:40], 5.0 - 0.5 * np.arange(1, 21), rtol=0, atol=1e-12)
    assert limited[40:].tolist() == [-5.0] * 20 and made(TorqueLimiter, limit=5.0).output_slew == 100.0


def test_infinite_slew_rate_disables_limit():
    assert by_hand(made(TorqueLimiter, limit=5.0, slew=math.inf), 2, torque=[9.0, -9.0])["limited"].tolist() == [
        5.0,
        -5.0,
    ]
    assert made(TorqueLimiter, limit=5.0, slew=math.inf).output_slew == math.inf


def test_the_default_slew_follows_a_live_limit():
    block = made(TorqueLimiter, limit=Live(4.0, max=10.0))
    assert block.output_slew == 200.0
    steps = []
    for block.limit in (4.0, 10.0):
        before = block.step(0.0) if not steps else block.scratch.arena[block.scratch.memory_start]
        steps.append(block.step(100.0) - before)
    assert steps == pytest.approx([0.4, 1.0])


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({}, "limit is missing"),
        ({"limit": -1.0}, "limit: must be at least 0.0 N·m, got -1.0"),
        ({"limit": math.nan}, "limit: NaN is not allowed"),
        ({"limit": 12.0, "slew": -1.0}, "slew: must be at least 0.0 N·m/s, got -1.0"),
        ({"limit": [1.0, 2.0]}, "limit: expected one number"),
        ({"limit": "12"}, "limit: expected a number, got '12'"),
        ({"limits": 12.0}, "has no parameter 'limits'\n.*did you mean 'limit'"),
    ],
)
def test_parameters_of_a_torque_limiter_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=f"TorqueLimiter: {said}"):
        TorqueLimiter(**parameters)


@given(u=st.lists(anything, min_size=1, max_size=10), ends=st.tuples(finite, finite))
def test_a_saturation_clips_and_returns_nan_for_non_finite_input(u, ends):
    lower, upper = min(ends), max(ends)
    block = made(Saturation, lower=lower, upper=upper)
    y = by_hand(block, len(u), u=u)["y"]
    assert np.array_equal(y, np.where(np.isfinite(u), np.clip(u, lower, upper), math.nan), equal_nan=True)


def test_a_saturation_clips_every_element_alone():
    u = np.random.default_rng(6).normal(0.0, 3.0, (50, 4))
    u[7, 2] = math.nan
    y = both_ways(lambda: Saturation(lower=-1.0, upper=2.5), u=u)["y"]
    assert np.array_equal(y, np.clip(u, -1.0, 2.5), equal_nan=True)


@given(bounds=st.lists(finite, min_size=4, max_size=4), share=st.floats(0.0, 1.0))
def test_saturation_range_contains_output_for_input_outside_limits(bounds, share):
    low, high = sorted(bounds[:2])
    lower, upper = sorted(bounds[2:])
    block = made(Saturation, lower=lower, upper=upper)
    y = block.step(min(low + share * (high - low), high))
    assert y in block.output_range(u=Interval(low, high))
    assert block.output_range(u=Interval(low, high)) in Interval(lower, upper)


def test_the_range_of_a_saturation_covers_its_live_bounds():
    block = made(Saturation, lower=Live(-1.0, min=-2.0, max=4.0), upper=Live(5.0, min=3.0, max=6.0))
    for lower in (-2.0, 0.0, 4.0):
        for upper in (3.0, 5.0, 6.0):
            block.lower, block.upper = lower, upper
            for u in (-9.0, 2.0, 9.0):
                assert block.step(u) in block.output_range(u=Interval(-9.0, 9.0))
    block = made(Saturation, lower=Live(-1.0, min=-2.0, max=0.0), upper=1.0)
    assert block.output_range(u=Interval(-9.0, -3.0)) == Interval(-2.0, 0.0)


def test_saturation_with_crossed_limits_is_refused():
    with pytest.raises(DiagramError, match=r"saturation: lower must be at most upper \(1\), got 2"):
        Saturation(lower=2.0)
    assert made(Saturation, lower=1.0, upper=1.0).step(5.0) == 1.0


@pytest.mark.parametrize("rate", [0.0, 1.0, 400.0, 1e9])
def test_a_slew_rate_is_a_torque_limiter_without_a_limit(rate):
    y = both_ways(lambda: SlewRate(rate=rate), u=NOISE)["y"]
    assert np.array_equal(y, limited(NOISE, math.inf, rate))


def test_a_slew_rate_follows_each_element_alone_and_does_not_hold_nan():
    u = np.zeros((6, 2))
    u[1:, 0], u[2, 1], u[3:, 1] = 9.0, math.nan, -9.0
    y = both_ways(lambda: SlewRate(rate=200.0), u=u)["y"]
    assert np.array_equal(y, [[0, 0], [1, 0], [2, math.nan], [3, -1], [4, -2], [5, -3]], equal_nan=True)


def test_a_slew_rate_stays_between_zero_and_its_input():
    block = made(SlewRate, rate=50.0)
    assert block.output_range(u=Interval(2.0, 3.0)) == Interval(0.0, 3.0)
    assert block.output_range(u=Interval(-3.0, -2.0)) == Interval(-3.0, 0.0)


def test_a_slew_rate_starts_at_its_finite_input_when_armed():
    block = made(SlewRate, rate=200.0)
    settle(block, u=5.0)
    assert block.step(9.0) == 6.0
    settle(block, u=math.nan)
    assert block.step(9.0) == 7.0
    pair = made(SlewRate, rate=200.0)
    pair.step([0.0, 0.0, 0.0])
    settle(pair, u=[5.0, -4.0, math.nan])
    assert pair.step([9.0, -9.0, 9.0]).tolist() == [6.0, -5.0, 1.0]


@pytest.mark.parametrize("value", [-0.1, math.nan])
def test_a_rate_below_zero_is_refused(value):
    with pytest.raises(DiagramError, match="SlewRate: rate: "):
        SlewRate(rate=value)


@pytest.mark.parametrize(
    "kind, parameters", [(TorqueLimiter, {"limit": 5.0, "slew": 100.0}), (SlewRate, {"rate": 100.0})]
)
def test_after_a_reset_they_start_from_zero_again(kind, parameters):
    block = made(kind, **parameters)
    first = [block.step(4.0) for _ in range(3)]
    assert math.isnan(block.step(math.nan))
    block.reset()
    assert [block.step(4.0) for _ in range(3)] == first == [0.5, 1.0, 1.5]


def test_slew_rate_maps_non_finite_input_to_nan_and_keeps_state():
    y = both_ways(lambda: SlewRate(100.0), u=np.array([0.0, 1.0, math.inf, -math.inf, math.nan, 1.0]))["y"]
    assert np.array_equal(y, [0.0, 0.5, math.nan, math.nan, math.nan, 1.0], equal_nan=True)


def test_a_zero_keeps_its_sign_through_a_saturation():
    assert [math.copysign(1.0, made(Saturation).step(zero)) for zero in (0.0, -0.0)] == [1.0, -1.0]
