"""Trigonometric functions. All are element-wise, with direct feedthrough and without state; NaN passes.

Infinity is neither an angle nor a ratio, and becomes NaN.
"""

from __future__ import annotations

import math

from blocks._plumbing.ranges import LIBM, PHASE_LIMIT, TURN, falling, holds_phase, outward, rising, wave
from cext.kernels import trigonometry as kernels
from graph import Block, Input, Interval, Output
from graph.interval import EVERYTHING


class Sin(Block):
    """Sine: y = sin u; NaN for an infinite angle."""

    u = Input("rad", "angle", shape=...)
    y = Output("1", "sine of the angle", shape=...)

    kernel = kernels.sine

    def output_range(self, u: Interval) -> Interval:
        return wave(math.sin, u, math.pi / 2)


class Cos(Block):
    """Cosine: y = cos u; NaN for an infinite angle."""

    u = Input("rad", "angle", shape=...)
    y = Output("1", "cosine of the angle", shape=...)

    kernel = kernels.cosine

    def output_range(self, u: Interval) -> Interval:
        return wave(math.cos, u, 0.0)


class Tan(Block):
    """Tangent: y = tan u; NaN for an infinite angle."""

    u = Input("rad", "angle", shape=...)
    y = Output("1", "tangent of the angle", shape=...)

    kernel = kernels.tangent

    def output_range(self, u: Interval) -> Interval:
        pole = (
            not u.bounded
            or u.high - u.low >= TURN / 2
            or max(-u.low, u.high) > PHASE_LIMIT
            or holds_phase(u, TURN / 4, TURN / 2)
        )
        return EVERYTHING if pole else rising(math.tan, u, LIBM)


class Asin(Block):
    """Arc sine: y = arcsin u, from -π/2 to π/2; NaN outside -1 to 1."""

    u = Input("1", "sine", shape=...)
    y = Output("rad", "angle", shape=...)

    kernel = kernels.arcsine

    def output_range(self, u: Interval) -> Interval:
        return rising(math.asin, Interval(-1.0, 1.0) & u, LIBM)


class Acos(Block):
    """Arc cosine: y = arccos u, from 0 to π; NaN outside -1 to 1."""

    u = Input("1", "cosine", shape=...)
    y = Output("rad", "angle", shape=...)

    kernel = kernels.arccosine

    def output_range(self, u: Interval) -> Interval:
        return falling(math.acos, Interval(-1.0, 1.0) & u, LIBM) & Interval(0.0, math.inf)


class Atan(Block):
    """Arc tangent: y = arctan u, from -π/2 to π/2."""

    u = Input("1", "tangent", shape=...)
    y = Output("rad", "angle", shape=...)

    kernel = kernels.arctangent

    def output_range(self, u: Interval) -> Interval:
        return rising(math.atan, u, LIBM)


class Atan2(Block):
    """Four-quadrant arc tangent: y = atan2(opposite, adjacent), from -π to π; atan2(0, 0) = 0."""

    opposite = Input("any", "second coordinate of the point", shape=...)
    adjacent = Input("any", "first coordinate of the point", shape=...)
    y = Output("rad", "angle from the first axis towards the second", shape=..., circle=(-math.pi, math.pi))

    kernel = kernels.angle

    def output_range(self, opposite: Interval, adjacent: Interval) -> Interval:
        if 0.0 in opposite and adjacent.low <= 0.0:  # the jump from -π to π; -0.0 lies below it
            return outward(-math.pi, math.pi, LIBM)
        corners = [math.atan2(y, x) for y in (opposite.low, opposite.high) for x in (adjacent.low, adjacent.high)]
        return outward(min(corners), max(corners), LIBM)
