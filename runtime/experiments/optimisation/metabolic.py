"""Metabolic power from respired gases, and its steady state from the first minutes after a change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

TIME_CONSTANT = 42.0  # s, of the respiratory response to a change (Selinger & Donelan 2014, J Appl Physiol 117:1406)
OXYGEN, CARBON_DIOXIDE = 16.58e3, 4.51e3  # J/L (Brockway 1987, Hum Nutr Clin Nutr 41C:463), without urinary nitrogen
LOWEST_POWER, HIGHEST_POWER = 20.0, 3000.0  # W, of a living adult; other values are errors of the file or its units
NUMERICAL = 1e-9  # relative error of a fit
BREATH_PERIOD, BREATH_DEVIATION = 3.0, 0.10  # s, and of one breath relative to the power
TRANSIENT_LIMIT = 0.02  # remainder of the transient below which the mean is the better estimate


@dataclass(frozen=True)
class Estimate:
    """Estimate of a cost.

    value, error : estimate and its standard error, in the unit of the samples; NaN for an unknown error
    count : number of samples
    """

    value: float
    error: float
    count: int


def power(oxygen: float, carbon_dioxide: float) -> float:
    """Return the metabolic power in W by the equation of Brockway.

    oxygen, carbon_dioxide : consumption and production in L/s (STPD)
    """
    return OXYGEN * oxygen + CARBON_DIOXIDE * carbon_dioxide


def plausible(watts: float) -> bool:
    """Return whether a metabolic power in W can be that of an adult. NaN is not."""
    return LOWEST_POWER <= watts <= HIGHEST_POWER


def steady_state(
    times: Sequence[float] | np.ndarray, rates: Sequence[float] | np.ndarray, time_constant: float = TIME_CONSTANT
) -> Estimate:
    """Return the steady state of a first-order response, by a linear least-squares fit.

        rate(t) = steady + (initial - steady) exp(-t / time constant)

    Zhang et al. 2017 (Science 356:1280) estimated it from two minutes after each change. The standard error is that of
    independent deviations of equal variance, which those of breaths are approximately.

    times : s since the change, in any order
    rates : rates at these times, such as the W of each breath
    time_constant : s; the rates after more than about four of them are averaged

    Raises ValueError for fewer than three rates, and for a steady state further from the rates than their range.
    """
    t, y = np.asarray(times, dtype=float), np.asarray(rates, dtype=float)
    if len(y) < 3:
        raise ValueError(f"{len(y)} samples: expected 3 or more")
    remainder = np.exp(-t / time_constant)
    if remainder.max() - remainder.min() < TRANSIENT_LIMIT:
        return mean(y)
    model = np.column_stack([np.ones_like(t), remainder])
    solution = np.linalg.lstsq(model, y, rcond=None)[0]
    variance = float(np.sum((y - model @ solution) ** 2)) / (len(y) - 2)
    covariance = np.linalg.inv(model.T @ model)
    low, high = float(y.min()), float(y.max())
    if not abs(solution[0] - 0.5 * (low + high)) <= 1.5 * (high - low) + NUMERICAL * abs(high):
        raise ValueError(
            f"the steady state of the fit, {solution[0]:.4g}, is far outside the samples, {low:.4g} to {high:.4g}: "
            "measure longer"
        )
    return Estimate(float(solution[0]), math.sqrt(variance * covariance[0, 0]), len(y))


def too_short(settle: float, measure: float, time_constant: float) -> bool:
    """Return whether a measurement is too short for `steady_state`: while the response changes, below a time constant.

    settle, measure, time_constant : s
    """
    change = math.exp(-settle / time_constant) - math.exp(-(settle + measure) / time_constant)
    return measure < time_constant and change >= TRANSIENT_LIMIT


def expected_noise(settle: float, measure: float, time_constant: float = TIME_CONSTANT) -> float:
    """Return the standard error of `steady_state` relative to the power, of breaths of a typical scatter.

    settle, measure : s after the change until the measurement, and its duration
    """
    t = settle + np.arange(0.5 * BREATH_PERIOD, measure, BREATH_PERIOD)
    remainder = np.exp(-t / time_constant)
    if remainder.max() - remainder.min() < TRANSIENT_LIMIT:
        return BREATH_DEVIATION / math.sqrt(len(t))
    model = np.column_stack([np.ones_like(t), remainder])
    return BREATH_DEVIATION * math.sqrt(np.linalg.inv(model.T @ model)[0, 0])


def mean(values: Sequence[float] | np.ndarray) -> Estimate:
    """Return the mean of independent values. Raises ValueError without a value."""
    y = np.asarray(values, dtype=float)
    if len(y) == 0:
        raise ValueError("0 samples: expected 1 or more")
    error = float(np.std(y, ddof=1)) / math.sqrt(len(y)) if len(y) > 1 else math.nan
    return Estimate(float(np.mean(y)), error, len(y))
