"""Functions of intervals, for the proof: what an output can be, from what its inputs can be."""

import math

import numpy as np

from graph import Interval

TURN = 2.0 * math.pi
FAR = 1e6  # rad, beyond which nothing is said of where in its turn an angle is
LIBM = 2  # units in the last place that libm may be off


def rising(function, u, ulps=0):
    """Interval of a function that never falls, from its ends. ulps: how far off the function may be, as libm is."""
    return outward(function(u.low), function(u.high), ulps)


def falling(function, u, ulps=0):
    """Return the interval of a function that falls over u, rounded outward by some ulps."""
    return outward(function(u.high), function(u.low), ulps)


def outward(low, high, ulps):
    """The interval from low to high, each end moved out by so many units in the last place."""
    for _ in range(ulps):
        low, high = math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    return Interval(low, high)


def hull(intervals):
    """The smallest interval that holds all of them."""
    first, *rest = intervals
    for interval in rest:
        first = first | interval
    return first


def total(intervals):
    """Interval of a sum, added from left to right."""
    first, *rest = intervals
    for interval in rest:
        first = first + interval
    return first


def can_be_true(u):
    """Return whether an interval has a value other than 0."""
    return not u.low == u.high == 0.0


def can_be_false(u):
    """Return whether an interval contains 0."""
    return 0.0 in u


def truth(true, false):
    """Interval of a bool, from whether it can be true and whether it can be false."""
    return Interval(0.0 if false else 1.0, 1.0 if true else 0.0)


def wave(function, u, peak):
    """Interval of a sine or cosine over u, in rad. peak: where it is 1."""
    if not u.bounded or u.high - u.low >= TURN or max(-u.low, u.high) > FAR:
        return Interval(-1.0, 1.0)
    ends = function(u.low), function(u.high)
    low = -1.0 if holds_phase(u, peak + TURN / 2) else min(ends)
    high = 1.0 if holds_phase(u, peak) else max(ends)
    return outward(low, high, LIBM) & Interval(-1.0, 1.0)


def holds_phase(u, phase, turn=TURN):
    """Whether an interval holds `phase` plus a whole number of turns, or comes near it."""
    slack = 1e-9
    return math.floor((u.high - phase) / turn + slack) >= math.ceil((u.low - phase) / turn - slack)


def horner(coefficients, u, pieces=1000):
    """Interval of a polynomial, the highest power first: over many pieces of u, so that it is tight.

    Every step rounds as the kernel does, which keeps order, so the ends hold in floating point.
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
            corners[np.isnan(corners)] = 0.0  # a bound of 0 times an infinite one
            low, high = corners.min(axis=0) + coefficient, corners.max(axis=0) + coefficient
    return Interval(float(low.min()), float(high.max()))
