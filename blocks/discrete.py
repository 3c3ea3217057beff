"""Delays, integrals and derivatives, in discrete time."""

import math

from cext.kernels import discrete as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING
from graph.units import divide, multiply


class Hold(Block):
    """Zero-order hold: y = u at its own ticks, and the same until the next of them. Simulink's Rate Transition.

    `Hold(every=3)` samples its input at every third tick, and may stand where rates meet that do not divide: between
    them y is up to one of its own periods older than u, by a varying amount. Where rates divide, each block holds its
    output by itself. Direct feedthrough; NaN passes.
    """

    u = Input("any", "input at another rate", shape=...)
    y = Output("any", "the input at the last of its own ticks", shape=...)

    kernel = kernels.hold
    resamples = True

    def output_range(self, u):
        return u


class UnitDelay(Block):
    """The input of the tick before: y[k] = u[k-1], and y[0] = initial.

    No direct feedthrough, so it may close a loop. NaN comes out a tick later and is not held.
    """

    initial = Param(0.0, "any", "output at the first tick", fixed=True)

    u = Input("any", "input", shape=...)
    y = Output("any", "input of the tick before", shape=...)
    held = Memory(0.0, "the input of the tick before")

    kernel = kernels.unit_delay
    update_kernel = kernels.unit_delay_next
    feedthrough = ()

    def prepare(self, dt):
        self.held = [self.initial] * self.width

    def start_range(self, u):
        return self.span("initial")

    def output_range(self, u):
        return u | self.span("initial")


class Delay(Block):
    """The input of n steps before: y[k] = u[k-n], and initial until there is one.

    No direct feedthrough, so it may close a loop. NaN comes out n steps later and is not held.
    """

    samples = Param(1, "1", "n", min=1, max=1_000_000, fixed=True)
    initial = Param(0.0, "any", "output at the first n ticks", fixed=True)

    u = Input("any", "input", shape=...)
    y = Output("any", "input of n steps before", shape=...)
    held = Memory(0.0, "the last n inputs")
    place = Memory(0.0, "where the oldest of them is")

    kernel = kernels.delay
    update_kernel = kernels.delay_next
    feedthrough = ()

    def prepare(self, dt):
        self.held = [self.initial] * (self.samples * self.width)

    def start_range(self, u):
        return self.span("initial")

    def output_range(self, u):
        return u | self.span("initial")


class Integrator(Block):
    """Integral over time, held inside limits: y += dt · u, from `initial`.

    forward       y[k] = y[k-1] + dt u[k-1]                  no direct feedthrough of u, so it may close a loop
    backward      y[k] = y[k-1] + dt u[k]
    trapezoidal   y[k] = y[k-1] + dt (u[k] + u[k-1]) / 2     with u[-1] = 0

    It is the state that is limited, so the integral leaves a limit as soon as u turns: no windup. While `restart` is
    true the output is `initial`. dt is the true time since the step before, also after missed ticks. NaN, or an
    infinity as NaN, stays until a restart.
    """

    initial = Param(0.0, "any", "output at the start and at a restart", fixed=True)
    lower = Param(-math.inf, "any", "smallest output")
    upper = Param(math.inf, "any", "largest output")
    method = Param("forward", "1", "of integration", choices=("forward", "backward", "trapezoidal"))

    u = Input("any", "what is integrated", shape=...)
    restart = Input("1", "whether to begin anew", dtype=bool, default=False)
    y = Output("any", "the integral", shape=...)
    state = Memory(0.0, "output of the tick before")
    held = Memory(0.0, "input of the tick before")

    kernel = kernels.integrator_forward

    def configure(self):
        if not self.lower <= self.initial <= self.upper:
            raise ValueError(f"initial, {self.initial:g}, is outside the limits, {self.lower:g} to {self.upper:g}")
        self.kernel = getattr(kernels, "integrator_" + self.method)
        self.update_kernel = kernels.integrator_forward_next if self.method == "forward" else None
        self.feedthrough = ("restart",) if self.method == "forward" else ("u", "restart")

    def prepare(self, dt):
        self.state, self.held = [self.initial] * self.width, [0.0] * self.width

    def output_units(self, u, restart):
        return {"y": multiply(u, "s")}

    def output_range(self, u, restart):
        initial, lower, upper = self.span("initial"), self.span("lower"), self.span("upper")
        falls, rises = initial | upper, initial | lower  # where an input of one sign leads, live limits included
        low = falls.low if u.low >= 0.0 else (falls | lower).low
        high = rises.high if u.high <= 0.0 else (rises | upper).high
        return Interval(low, high)


class Derivative(Block):
    """Filtered derivative: y[k] = (u[k] - v[k-1]) / (τ + dt), with v following u by τ dv/dt = u - v in backward
    differences.

    Its transfer function is s / (τ s + 1); with τ = 0 it is the plain difference quotient. Direct feedthrough. Starts
    at 0, whatever the first input is. dt is the true time since the step before. NaN and infinity pass and are not
    held: the next slope is taken from the last number.
    """

    time_constant = Param(0.0, "s", "τ of the filter: noise above 1/(2π τ) is not amplified further", min=0.0)

    u = Input("any", "input", shape=...)
    y = Output("any", "du/dt", shape=...)
    follower = Memory(math.nan, "v")

    kernel = kernels.derivative

    def prepare(self, dt):
        self.follower = [math.nan] * self.width

    def output_units(self, u):
        return {"y": divide(u, "s")}

    def output_range(self, u):
        if self.dt is None or not u.bounded:
            return EVERYTHING
        rounding = 1e-14 * max(abs(u.low), abs(u.high)) / self.dt
        most = (u.high - u.low) / (self.span("time_constant").low + self.dt) + rounding
        return Interval(-most, most)
