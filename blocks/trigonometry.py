"""Trigonometry on signals. All have direct feedthrough and no state, and work element by element; NaN passes, and an
infinity, which is no angle and no ratio, becomes NaN.
"""

import math

from blocks._plumbing.ranges import FAR, LIBM, TURN, falling, holds_phase, outward, rising, wave
from cext.kernels import trigonometry as kernels
from graph import Block, Input, Interval, Output
from graph.interval import EVERYTHING


class Sin(Block):
    """Sine of an angle: y = sin u; NaN for an infinite one."""

    u = Input("rad", "angle", shape=...)
    y = Output("1", "its sine", shape=...)

    kernel = kernels.sine

    def output_range(self, u):
        return wave(math.sin, u, math.pi / 2)


class Cos(Block):
    """Cosine of an angle: y = cos u; NaN for an infinite one."""

    u = Input("rad", "angle", shape=...)
    y = Output("1", "its cosine", shape=...)

    kernel = kernels.cosine

    def output_range(self, u):
        return wave(math.cos, u, 0.0)


class Tan(Block):
    """Tangent of an angle: y = tan u; NaN for an infinite one."""

    u = Input("rad", "angle", shape=...)
    y = Output("1", "its tangent", shape=...)

    kernel = kernels.tangent

    def output_range(self, u):
        pole = (
            not u.bounded
            or u.high - u.low >= TURN / 2
            or max(-u.low, u.high) > FAR
            or holds_phase(u, TURN / 4, TURN / 2)
        )
        return EVERYTHING if pole else rising(math.tan, u, LIBM)


class Asin(Block):
    """Angle of a sine: y = arcsin u, from -π/2 to π/2; NaN outside -1 to 1."""

    u = Input("1", "sine", shape=...)
    y = Output("rad", "angle", shape=...)

    kernel = kernels.arcsine

    def output_range(self, u):
        return rising(math.asin, Interval(-1.0, 1.0) & u, LIBM)


class Acos(Block):
    """Angle of a cosine: y = arccos u, from 0 to π; NaN outside -1 to 1."""

    u = Input("1", "cosine", shape=...)
    y = Output("rad", "angle", shape=...)

    kernel = kernels.arccosine

    def output_range(self, u):
        return falling(math.acos, Interval(-1.0, 1.0) & u, LIBM) & Interval(0.0, math.inf)


class Atan(Block):
    """Angle of a tangent: y = arctan u, from -π/2 to π/2."""

    u = Input("1", "tangent", shape=...)
    y = Output("rad", "angle", shape=...)

    kernel = kernels.arctangent

    def output_range(self, u):
        return rising(math.atan, u, LIBM)


class Atan2(Block):
    """Angle of a point: y = atan2(opposite, adjacent), from -π to π, in all four quadrants; atan2(0, 0) = 0."""

    opposite = Input("any", "its second coordinate", shape=...)
    adjacent = Input("any", "its first coordinate", shape=...)
    y = Output("rad", "angle from the first axis towards the second", shape=..., circle=(-math.pi, math.pi))

    kernel = kernels.angle

    def output_range(self, opposite, adjacent):
        if 0.0 in opposite and adjacent.low <= 0.0:  # the jump from -π to π; -0.0 lies below it
            return outward(-math.pi, math.pi, LIBM)
        corners = [math.atan2(y, x) for y in (opposite.low, opposite.high) for x in (adjacent.low, adjacent.high)]
        return outward(min(corners), max(corners), LIBM)
