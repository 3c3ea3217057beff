"""Delays, integrators and derivatives in discrete time."""

from __future__ import annotations

import math

from cext.kernels import discrete as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING
from graph.units import divide, multiply


class Hold(Block):
    """Zero-order hold: y = u at the ticks of the block, constant between them.   (Simulink's Rate Transition)

    `Hold(every=3)` samples its input at every third tick. Use it between rates that are not multiples of each other: y
    is then older than u by a varying amount of up to one period of the block. Between other rates every block holds its
    output. Direct feedthrough; NaN passes.
    """

    u = Input("any", "input at another rate", shape=...)
    y = Output("any", "input at the last tick of the block", shape=...)

    passes_jumps = True
    kernel = kernels.hold
    resamples = True

    def output_range(self, u: Interval) -> Interval:
        return u


class UnitDelay(Block):
    """Delay by one tick: y[k] = u[k-1], y[0] = initial.

    No direct feedthrough, so it may close a loop. NaN passes one tick later and is not held.
    """

    initial = Param(0.0, "any", "output at the first tick", fixed=True)

    u = Input("any", "input", shape=...)
    y = Output("any", "input of the previous tick", shape=...)
    held = Memory(0.0, "input of the previous tick")

    passes_jumps = True
    kernel = kernels.unit_delay
    update_kernel = kernels.unit_delay_next
    feedthrough = ()

    def prepare(self, dt: float | None) -> None:
        self.held = [self.initial] * self.width

    def start_range(self, u: Interval) -> Interval:
        return self.span("initial")

    def output_range(self, u: Interval) -> Interval:
        return u | self.span("initial")


class Delay(Block):
    """Delay by n samples: y[k] = u[k-n], y = initial for the first n steps.

    No direct feedthrough, so it may close a loop. NaN passes n steps later and is not held.
    """

    samples = Param(1, "1", "delay n in samples", min=1, max=1_000_000, fixed=True)
    initial = Param(0.0, "any", "output for the first n steps", fixed=True)

    u = Input("any", "input", shape=...)
    y = Output("any", "input n steps before", shape=...)
    held = Memory(0.0, "last n inputs")
    place = Memory(0.0, "index of the oldest input")

    passes_jumps = True
    kernel = kernels.delay
    update_kernel = kernels.delay_next
    feedthrough = ()

    def prepare(self, dt: float) -> None:
        self.held = [self.initial] * (self.samples * self.width)

    def start_range(self, u: Interval) -> Interval:
        return self.span("initial")

    def output_range(self, u: Interval) -> Interval:
        return u | self.span("initial")


class Integrator(Block):
    """Integral over time with limits: y += dt · u, starting at `initial`.

        forward       y[k] = y[k-1] + dt u[k-1]                no direct feedthrough of u: may close a loop
        backward      y[k] = y[k-1] + dt u[k]
        trapezoidal   y[k] = y[k-1] + dt (u[k] + u[k-1]) / 2   with u[-1] = 0

    The state itself is limited, so the integral leaves a limit as soon as u changes sign: no windup. While `restart` is
    true the output is `initial`. dt is the actual time since the previous step, even after missed ticks. NaN persists
    until a restart, and infinity becomes NaN. `forward` makes an oscillation of a plant grow: use ContinuousIntegrator.
    """

    rules = ("lower <= initial <= upper",)
    held_within = {"y": ("lower", "upper"), "state": ("lower", "upper")}

    initial = Param(0.0, "any", "output at the start and after a restart", fixed=True)
    lower = Param(-math.inf, "any", "smallest output")
    upper = Param(math.inf, "any", "largest output")
    method = Param("forward", "1", "integration method", choices=("forward", "backward", "trapezoidal"))

    u = Input("any", "integrand", shape=...)
    restart = Input("1", "true resets the output to `initial`", dtype=bool, default=False)
    y = Output("any", "integral of u", shape=...)
    state = Memory(0.0, "output of the previous tick")
    held = Memory(0.0, "input of the previous tick")

    kernel = kernels.integrator_forward

    def configure(self) -> None:
        self.kernel = getattr(kernels, "integrator_" + self.method)
        self.update_kernel = kernels.integrator_forward_next if self.method == "forward" else None
        self.feedthrough = ("restart",) if self.method == "forward" else ("u", "restart")

    def prepare(self, dt: float) -> None:
        self.state, self.held = [self.initial] * self.width, [0.0] * self.width

    def output_units(self, u: str, restart: str) -> dict[str, str]:
        return {"y": multiply(u, "s")}

    def output_range(self, u: Interval, restart: Interval) -> Interval:
        initial, lower, upper = self.span("initial"), self.span("lower"), self.span("upper")
        falls, rises = initial | upper, initial | lower  # reachable with an input of one sign, including live limits
        low = falls.low if u.low >= 0.0 else (falls | lower).low
        high = rises.high if u.high <= 0.0 else (rises | upper).high
        return Interval(low, high)


class Derivative(Block):
    """Filtered derivative: H(s) = s / (τ s + 1), y[k] = (u[k] - v[k-1]) / (τ + dt).

    v follows u according to τ dv/dt = u - v, in backward differences. With τ = 0 the output is the difference quotient.
    Direct feedthrough. Starts at 0 for any first input. dt is the actual time since the previous step. NaN and infinity
    pass and are not held: the next slope refers to the last finite input.
    """

    time_constant = Param(0.0, "s", "filter time constant τ; above 1/(2π τ) the gain is constant", min=0.0)

    u = Input("any", "input", shape=...)
    y = Output("any", "derivative du/dt", shape=...)
    follower = Memory(math.nan, "filter state v")

    smooth = ("u",)
    kernel = kernels.derivative

    def prepare(self, dt: float) -> None:
        self.follower = [math.nan] * self.width

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": divide(u, "s")}

    def output_range(self, u: Interval) -> Interval:
        if self.dt is None or not u.bounded:
            return EVERYTHING
        rounding = 1e-14 * max(abs(u.low), abs(u.high)) / self.dt
        bound = (u.high - u.low) / (self.span("time_constant").low + self.dt) + rounding
        return Interval(-bound, bound)


class Unwrap(Block):
    """Angle without jumps: y = u plus the whole turns since the start.

        Butterworth(cutoff=6.0)(Unwrap()(attitude.yaw))
        Derivative()(Unwrap(period=1.0)(gait.phase))

    A change by more than half a period since the last finite input counts as the shorter way in the other direction, so
    the input must turn by less than half a period per tick. Starts at u. Direct feedthrough. NaN passes, infinity
    becomes NaN; neither is stored.
    """

    period = Param(math.tau, "any", "one turn: 2π for an angle, 1 for a phase", above=0.0, fixed=True)

    u = Input("any", "angle or phase that jumps by a period", shape=...)
    y = Output("any", "u without jumps", shape=...)
    last = Memory(math.nan, "last finite input")
    turns = Memory(0.0, "whole turns since the start")

    kernel = kernels.unwrap

    def prepare(self, dt: float) -> None:
        self.last, self.turns = [math.nan] * self.width, [0.0] * self.width
