"""Delays, integrators and derivatives: against SciPy and plain Python."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks.discrete import Delay, Derivative, Integrator, UnitDelay, Unwrap
from blocks.mathematics import Gain
from blocks.sources import StepSource
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, DiagramError, Interval, Live, compile
from tests.blocks.playing import made, play, taker

RATE = 250.0
DT = 1.0 / RATE
NOISE = np.random.default_rng(14).normal(0.0, 2.0, 400)


@pytest.mark.parametrize("samples", [1, 2, 7, 399, 1000])
def test_a_delay_returns_the_input_of_n_ticks_ago(samples):
    y = play(lambda: Delay(samples, initial=-3.0), RATE, u=NOISE)["y"]
    assert np.array_equal(y, np.r_[np.full(samples, -3.0), NOISE][: len(NOISE)])
    rows = NOISE.reshape(200, 2)
    y = play(lambda: Delay(samples), RATE, u=rows)["y"]
    assert np.array_equal(y, np.vstack([np.zeros((samples, 2)), rows])[:200])


def test_consecutive_delays_add_up_and_close_loops():
    with Diagram("ring", rate=RATE) as diagram:
        first, second, third = Delay(2, initial=1.0), UnitDelay(), Delay(3)
        first(third.y), second(first.y), third(Gain(2.0)(second.y))
        y = taker(first.y, (), 20)
    Executor(Program(compile(diagram)), RATE).spin(20)
    assert y.tolist() == [
        1.0,
        1.0,
        0.0,
        0.0,
        0.0,
        0.0,
        2.0,
        2.0,
        0.0,
        0.0,
        0.0,
        0.0,
        4.0,
        4.0,
        0.0,
        0.0,
        0.0,
        0.0,
        8.0,
        8.0,
    ]


def test_a_delay_stays_inside_its_input_and_its_initial_value_and_does_not_hold_nan():
    assert Delay(3, initial=5.0).output_range(u=Interval(-1.0, 2.0)) == Interval(-1.0, 5.0)
    y = play(lambda: Delay(2), RATE, u=[1.0, math.nan, 3.0, 4.0, 5.0])["y"]
    assert np.array_equal(y, [0.0, 0.0, 1.0, math.nan, 3.0], equal_nan=True)


@pytest.mark.parametrize(
    "method, b", [("forward", [0.0, DT]), ("backward", [DT, 0.0]), ("trapezoidal", [DT / 2, DT / 2])]
)
def test_each_method_of_integration_is_its_filter(method, b):
    y = play(lambda: Integrator(method=method), RATE, u=NOISE)["y"]
    assert np.abs(y - signal.lfilter(b, [1.0, -1.0], NOISE)).max() < 1e-12


def test_the_trapezoidal_rule_integrates_a_cosine_to_second_order():
    t = np.arange(1000) * DT
    y = play(lambda: Integrator(method="trapezoidal"), RATE, u=np.cos(t))["y"]
    offset = y[0] - np.sin(t[0])  # the half step before the first tick
    assert np.abs(y - offset - np.sin(t)).max() < DT**2


def test_an_integral_stops_at_its_limit_and_leaves_it_as_soon_as_the_input_turns():
    u = np.r_[np.full(200, 10.0), np.full(200, -10.0)]
    y = play(lambda: Integrator(lower=-1.0, upper=2.0, method="backward"), RATE, u=u)["y"]
    assert y.max() == 2.0 and y[199] == 2.0 and abs(y[200] - (2.0 - 10.0 * DT)) < 1e-15 and y.min() == -1.0


@pytest.mark.parametrize(
    "method, expected",
    [
        ("forward", [5.0, 6.0, 5.0, 5.0, 6.0, 7.0]),
        ("backward", [6.0, 7.0, 5.0, 5.0, 6.0, 7.0]),
        ("trapezoidal", [5.5, 6.5, 5.0, 5.0, 6.0, 7.0]),
    ],
)
def test_restart_holds_initial_value_then_integrates(method, expected):
    restart = np.array([0, 0, 1, 1, 0, 0], dtype=bool)
    y = play(lambda: Integrator(initial=5.0, method=method), RATE, u=np.full(6, RATE), restart=restart)["y"]
    assert np.abs(y - expected).max() < 1e-12


def test_an_integrator_by_forward_differences_closes_a_loop():
    """dx/dt = -x by Euler: (1 - dt)^k."""
    with Diagram("decay", rate=RATE) as diagram:
        state = Integrator(initial=1.0)
        state(Gain(-1.0)(state.y))
        y = taker(state.y, (), 300)
    Executor(Program(compile(diagram)), RATE).spin(300)
    assert np.abs(y - (1.0 - DT) ** np.arange(300)).max() < 1e-13


def test_nan_persists_in_an_integral_until_a_restart():
    for method in ("forward", "backward", "trapezoidal"):
        block = made(Integrator, method=method, rate=RATE)
        seen = []
        for u, restart in (
            (1.0, False),
            (math.nan, False),
            (1.0, False),
            (1.0, False),
            (1.0, True),
            (1.0, False),
            (1.0, math.nan),
        ):
            seen.append(block.step(u, restart))
            if block.update_kernel is not None:
                block.update(u, restart)
        assert (
            math.isnan(seen[2])
            and math.isnan(seen[3])
            and seen[4] == 0.0
            and not math.isnan(seen[5])
            and math.isnan(seen[6])
        )


def test_range_of_integral_is_its_limits_and_follows_input_sign():
    block = made(Integrator, initial=1.0, lower=-2.0, upper=5.0)
    on = Interval(0.0, 1.0)
    assert block.output_range(Interval(-1.0, 1.0), on) == Interval(-2.0, 5.0)
    assert block.output_range(Interval(0.0, 1.0), on) == Interval(1.0, 5.0)
    assert block.output_range(Interval(-1.0, 0.0), on) == Interval(-2.0, 1.0)
    assert made(Integrator).output_range(Interval(0.0, 1.0), on) == Interval(0.0)


@given(
    u=st.lists(st.floats(-1e9, 1e9), max_size=30),
    steps=st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)), min_size=30, max_size=30),
)
def test_an_integral_with_live_limits_stays_in_its_range(u, steps):
    block = made(Integrator, lower=Live(-1.0, min=-3.0, max=3.0), upper=Live(1.0, min=-3.0, max=3.0), method="backward")
    found = block.output_range(Interval(-1e9, 1e9), Interval(0.0, 0.0))
    assert found == Interval(-3.0, 3.0)
    for x, (lower, upper) in zip(u, steps):
        block.lower, block.upper = lower, upper
        assert block.step(x) in found


@pytest.mark.parametrize("time_constant", [0.0, 0.01, 1.0])
def test_a_derivative_equals_its_filter_equation(time_constant):
    """(1 - 1/z) / ((τ + dt) - τ/z), started at its first input."""
    u = np.r_[0.0, NOISE]
    y = play(lambda: Derivative(time_constant), RATE, u=u)["y"]
    wanted = signal.lfilter([1.0, -1.0], [time_constant + DT, -time_constant], u)
    assert np.abs(y - wanted).max() < 1e-10 * max(1.0, np.abs(wanted).max())


def test_a_derivative_starts_at_zero_and_measures_the_slope_of_a_ramp():
    y = play(lambda: Derivative(0.02), RATE, u=7.0 + 3.0 * np.arange(200) * DT)["y"]
    assert y[0] == 0.0 and abs(y[-1] - 3.0) < 1e-4 and np.all(np.diff(y) >= -1e-12)


def test_nan_passes_a_derivative_and_is_not_held():
    y = play(lambda: Derivative(), RATE, u=[1.0, math.nan, 2.0, 2.0])["y"]
    assert y[0] == 0.0 and math.isnan(y[1]) and y[2] == RATE and y[3] == 0.0


@given(
    u=st.lists(st.sampled_from([-7.0, -6.999999, 0.3, 2.0, 1.999999]), min_size=1, max_size=60),
    time_constant=st.sampled_from([0.0, 1e-6, 0.004, 3.0]),
)
def test_a_slope_stays_inside_its_range(u, time_constant):
    block = made(Derivative, time_constant, rate=RATE)
    found = block.output_range(u=Interval(-7.0, 2.0))
    assert all(block.step(x) in found for x in u)


def test_the_worst_input_brings_a_slope_near_its_range():
    found = made(Derivative, 0.1, rate=RATE).output_range(u=Interval(-7.0, 2.0))
    y = play(lambda: Derivative(0.1), RATE, u=np.r_[np.full(10, -7.0), 2.0])["y"]
    assert abs(y[-1] - found.high) < 1e-9 and y[-1] <= found.high and abs(found.high - 9.0 / (0.1 + DT)) < 1e-9
    assert Derivative().output_range(u=Interval(-1.0, 1.0)) == Interval(), "without a rate nothing is known"


@pytest.mark.parametrize("period", [math.tau, 1.0])
def test_an_unwrapped_angle_is_that_of_numpy_and_nan_is_not_held(period):
    angle = np.cumsum(np.random.default_rng(3).uniform(-0.49, 0.49, (500, 2)) * period, axis=0)
    u = (angle + period / 2.0) % period - period / 2.0
    assert play(lambda: Unwrap(period), RATE, u=u)["y"] == pytest.approx(np.unwrap(u, axis=0, period=period), abs=1e-12)
    gaps = u[:, 0].copy()
    gaps[[0, 7, 200]] = math.nan, math.nan, math.inf
    y = play(lambda: Unwrap(period), RATE, u=gaps)["y"]
    known = np.isfinite(gaps)
    assert np.isnan(y[~known]).all() and y[known] == pytest.approx(np.unwrap(gaps[known], period=period), abs=1e-12)


def test_derivative_and_integrator_units_include_the_second():
    with Diagram("units", rate=RATE) as diagram:
        velocity = Derivative()(StepSource()())
        Integrator()(velocity)
    compile(diagram)
    assert Derivative().output_units(u="rad") == {"y": "rad/s"} and Integrator().output_units(
        u="rad/s", restart="1"
    ) == {"y": "rad"}


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: Delay(0), "samples: must be at least 1, got 0"),
        (lambda: Integrator(initial=2.0, upper=1.0), r"initial must be at most upper \(1\), got 2"),
        (lambda: Integrator(method="euler"), "method: must be one of forward, backward, trapezoidal"),
        (lambda: Derivative(-0.1), "time_constant: must be at least 0"),
    ],
)
def test_inconsistent_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()
