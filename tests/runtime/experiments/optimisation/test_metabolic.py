"""Metabolic estimates: equation of Brockway, and the steady state from two minutes of a first-order response."""

import math

import numpy as np
import pytest

from runtime.experiments.optimisation.metabolic import Estimate, mean, power, steady_state, too_short


def test_brockway_equation_gives_published_power_of_walking():
    # 1 L of oxygen at a respiratory quotient of 0.85: 16.58 + 0.85 * 4.51 kJ
    assert power(1.0, 0.85) == pytest.approx(20413.5, abs=0.1)
    assert power(1.2 / 60, 1.0 / 60) == pytest.approx(406.8, abs=0.1)


def breaths(source, steady, initial, noise, begin=0.0, end=120.0):
    t = begin + np.cumsum(source.gamma(9.0, 3.0 / 9.0, size=200))
    t = t[t < end]
    exact = steady + (initial - steady) * np.exp(-t / 42.0)
    return t, exact * (1.0 + noise * source.standard_normal(len(t)))


def test_two_minutes_give_exact_steady_state_without_noise():
    t, y = breaths(np.random.default_rng(0), 320.0, 420.0, 0.0)
    assert y[-1] > 325.0  # the response has not ended
    estimate = steady_state(t, y)
    assert estimate.value == pytest.approx(320.0, abs=1e-9) and estimate.error < 1e-9


def test_standard_error_is_that_of_many_repetitions():
    source = np.random.default_rng(1)
    estimates = [steady_state(*breaths(source, 320.0, 420.0, 0.1)) for _ in range(400)]
    values, errors = [[getattr(each, name) for each in estimates] for name in ("value", "error")]
    assert np.mean(values) == pytest.approx(320.0, abs=2.0)
    assert np.std(values) == pytest.approx(np.mean(errors), rel=0.12)
    assert np.std(values) < 0.06 * 320.0


def test_a_steady_state_far_outside_the_rates_is_no_estimate():
    t = np.arange(0.5, 5.0, 1.0)  # of a response with 42 s
    with pytest.raises(
        ValueError, match=r"the steady state of the fit, -[\d.]+, is far outside the samples, 380 to 420: meas"
    ):
        steady_state(t, 420.0 - 10.0 * (t - 0.5))


def test_measurements_below_a_time_constant_are_too_short_unless_the_response_has_ended():
    assert too_short(1.0, 5.0, 42.0) and too_short(60.0, 5.0, 42.0)
    assert not too_short(1.0, 42.0, 42.0) and not too_short(200.0, 5.0, 42.0)


def test_late_rates_are_averaged():
    t, y = breaths(np.random.default_rng(2), 320.0, 420.0, 0.1, begin=300.0, end=420.0)
    assert steady_state(t, y) == mean(y)


def test_too_few_samples_are_no_estimate():
    with pytest.raises(ValueError, match="2 samples: expected 3 or more"):
        steady_state([1.0, 2.0], [300.0, 301.0])
    with pytest.raises(ValueError, match="0 samples"):
        mean([])
    assert mean([5.0]) == Estimate(5.0, pytest.approx(math.nan, nan_ok=True), 1)
