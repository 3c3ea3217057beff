"""Limiters: what stands between a controller and a person. Each lets NaN pass, so that the actuator sees it and faults."""

import math

from cext.kernels import limiters as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class Saturation(Block):
    """Clips: y = min(max(u, lower), upper). Direct feedthrough; NaN passes."""

    lower = Param(-1.0, "any", "smallest output")
    upper = Param(1.0, "any", "largest output")

    u = Input("any", "input", shape=...)
    y = Output("any", "clipped", shape=...)

    kernel = kernels.saturation

    def configure(self):
        if self.lower > self.upper:
            raise ValueError(f"lower, {self.lower:g}, is above upper, {self.upper:g}")

    def output_range(self, u):
        lower, upper = self.span("lower"), self.span("upper")
        if lower.high > upper.low:              # live bounds that may cross
            return lower | upper
        return Interval(min(max(u.low, lower.low), upper.low), min(max(u.high, lower.high), upper.high))


class SlewRate(Block):
    """Follows the input at a bounded rate: |y[k] - y[k-1]| <= rate · dt.

    Starts at zero, or at the present input when armed. Direct feedthrough; NaN passes and is not held.
    """

    rate = Param(1.0, "any", "largest change a second", min=0.0)

    u = Input("any", "input", shape=...)
    y = Output("any", "followed", shape=...)
    previous = Memory(0.0, "output of the tick before")

    kernel = kernels.slew
    settle_kernel = kernels.slew_at_rest

    def prepare(self, dt):
        self.previous = [0.0] * self.width

    def output_range(self, u):
        return u | Interval.point(0.0)


class TorqueLimiter(Block):
    """Bounds a torque and how fast it changes: |τ| <= limit, |dτ/dt| <= slew.

    Principle: 1. the input is clipped to ± limit; 2. the output moves toward it by at most slew · dt, so it never leaves the interval that
    holds both. A limit lowered while running holds at once. Starts at zero. NaN passes, is not held, and is a fault at the actuator.
    """

    limit = Param(1.0, "N·m", "largest torque, either way", min=0.0, required=True)
    slew = Param(math.inf, "N·m/s", "fastest change, either way", min=0.0)

    torque = Input("N·m", "asked for")
    limited = Output("N·m", "let through")
    previous = Memory(0.0, "output of the tick before")

    kernel = kernels.torque_limiter

    def output_range(self, torque):
        return Interval(-self.span("limit").high, self.span("limit").high)
