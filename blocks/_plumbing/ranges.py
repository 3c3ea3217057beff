"""Interval functions for the range proof."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from graph import Interval

TURN = 2.0 * math.pi
PHASE_LIMIT = 1e6  # rad, above which the phase of an angle is considered unknown
LIBM = 2  # error bound of libm in units in the last place


def rising(function: Callable[[float], float], u: Interval, ulps: int = 0) -> Interval:
    """Return the interval of a non-decreasing function. ulps : error bound of the function"""
    return outward(function(u.low), function(u.high), ulps)


def falling(function: Callable[[float], float], u: Interval, ulps: int = 0) -> Interval:
    """Return the interval of a non-increasing function. ulps : error bound of the function"""
    return outward(function(u.high), function(u.low), ulps)


def outward(low: float, high: float, ulps: int) -> Interval:
    """Return the interval from low to high, widened by `ulps` units in the last place at each end."""
    for _ in range(ulps):
        low, high = math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    return Interval(low, high)


def hull(intervals: Sequence[Interval] | Iterable[Any]) -> Interval:
    """Return the smallest interval that contains all intervals."""
    first, *rest = intervals
    for interval in rest:
        first = first | interval
    return first


def total(intervals: Sequence[Interval]) -> Interval:
    """Return the interval of a sum, added from left to right."""
    first, *rest = intervals
    for interval in rest:
        first = first + interval
    return first


def can_be_true(u: Interval) -> bool:
    """Return whether the interval contains a nonzero number."""
    return not u.low == u.high == 0.0


def can_be_false(u: Interval) -> bool:
    """Return whether the interval contains 0."""
    return 0.0 in u


def truth(true: bool, false: bool) -> Interval:
    """Return the interval of a bool that can be true and can be false."""
    return Interval(0.0 if false else 1.0, 1.0 if true else 0.0)


def wave(function: Callable[[float], float], u: Interval, peak: float) -> Interval:
    """Return the interval of a sine or cosine over u in rad. peak : angle at which it is 1"""
    if not u.bounded or u.high - u.low >= TURN or max(-u.low, u.high) > PHASE_LIMIT:
        return Interval(-1.0, 1.0)
    ends = function(u.low), function(u.high)
    low = -1.0 if holds_phase(u, peak + TURN / 2) else min(ends)
    high = 1.0 if holds_phase(u, peak) else max(ends)
    return outward(low, high, LIBM) & Interval(-1.0, 1.0)


def holds_phase(u: Interval, phase: float, turn: float = TURN) -> bool:
    """Return whether an interval contains `phase` plus an integer number of turns, with a small margin."""
    slack = 1e-9
    return math.floor((u.high - phase) / turn + slack) >= math.ceil((u.low - phase) / turn - slack)


def horner(coefficients: tuple[float, ...], u: Interval, pieces: int = 1000) -> Interval:
    """Return the interval of a polynomial with coefficients in decreasing powers.

    It is evaluated over many pieces of u for a tight bound. Every step rounds like the kernel, and rounding is
    monotonic, so the bounds are valid in floating point.
    """
    if u.bounded and math.isfinite(u.high - u.low):
        edges = np.linspace(u.low, u.high, pieces + 1)
    else:
        edges = np.array([u.low, 0.0, u.high] if 0.0 in u else [u.low, u.high])
    x = edges[:-1], edges[1:]
    low = high = np.full(len(edges) - 1, float(coefficients[0]))
    with np.errstate(all="ignore"):
        for coefficient in coefficients[1:]:
            corners = np.array([a * b for a in (low, high) for b in x])
            corners[np.isnan(corners)] = 0.0  # 0 times an infinite bound
            low, high = corners.min(axis=0) + coefficient, corners.max(axis=0) + coefficient
    return Interval(float(low.min()), float(high.max()))
