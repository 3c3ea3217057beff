"""Limiters. NaN passes and infinity becomes NaN, which is a fault at the actuator."""

from __future__ import annotations

import math

from blocks._plumbing.filter_bounds import design_at
from blocks.windows import samples_in
from cext.kernels import limiters as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class Saturation(Block):
    """Saturation: y = min(max(u, lower), upper).

    Direct feedthrough; NaN passes and infinity becomes NaN.
    """

    rules = ("lower <= upper",)
    held_within = {"y": ("lower", "upper")}

    lower = Param(-1.0, "any", "smallest output")
    upper = Param(1.0, "any", "largest output")

    u = Input("any", "input", shape=...)
    y = Output("any", "clipped input", shape=...)

    clips = True
    kernel = kernels.saturation

    def output_range(self, u: Interval) -> Interval:
        lower, upper = self.span("lower"), self.span("upper")
        return Interval(min(max(u.low, lower.low), upper.low), min(max(u.high, lower.high), upper.high))


class SlewRate(Block):
    """Rate limiter: y[k] = y[k-1] + clip(u[k] - y[k-1], ± rate · dt).

    Starts at zero, and after arming at the present input. Direct feedthrough; NaN passes, infinity becomes NaN, and
    neither is held.
    """

    rate = Param(1.0, "any", "largest change per second", min=0.0)

    u = Input("any", "input", shape=...)
    y = Output("any", "rate-limited input", shape=...)
    previous = Memory(0.0, "output of the previous tick")

    smooth = ("u",)
    kernel = kernels.slew
    settle_kernel = kernels.slew_at_rest

    def prepare(self, dt: float) -> None:
        self.previous = [0.0] * self.width

    def output_range(self, u: Interval) -> Interval:
        return u | Interval.point(0.0)


class TorqueLimiter(Block):
    """Limiter of a torque and its rate of change: |τ| <= limit, |dτ/dt| <= slew.

    Principle: 1. the input is clipped to ± limit; 2. the output moves toward it by at most slew · dt, so it never
    leaves the interval between them. The default slew crosses the whole range in 0.1 s: 20 limit per second, following
    a live limit; `slew=math.inf` disables it. A limit that is lowered during the run applies at once. Starts at zero.
    NaN passes, infinity becomes NaN, neither is held, and both are a fault at the actuator.
    """

    held_within = {"limited": ("-limit", "limit"), "previous": ("-limit", "limit")}

    limit = Param(1.0, "N·m", "largest magnitude of the torque", min=0.0, required=True)
    slew = Param(None, "N·m/s", "largest rate of change; the whole range in 0.1 s by default", min=0.0, dtype=float)

    torque = Input("N·m", "requested torque")
    limited = Output("N·m", "limited torque")
    previous = Memory(0.0, "output of the previous tick")

    clips = True
    kernel = kernels.torque_limiter
    examples = ({"limit": 12.0}, {"limit": 12.0, "slew": 200.0})

    def output_range(self, torque: Interval) -> Interval:
        return Interval(-self.span("limit").high, self.span("limit").high)

    @property
    def output_slew(self) -> float:
        """Largest rate of change in N·m/s: the slew, or its default for the largest limit."""
        return 20.0 * self.span("limit").high if self.slew is None else self.span("slew").high


class DeadZone(Block):
    """Dead zone: y = u - lower for u < lower, u - upper for u > upper, 0 between.

    Direct feedthrough; NaN passes, infinity becomes NaN.
    """

    rules = ("lower <= upper",)

    lower = Param(-1.0, "any", "lower end of the zone")
    upper = Param(1.0, "any", "upper end of the zone")

    u = Input("any", "input", shape=...)
    y = Output("any", "excess of the input over the zone", shape=...)

    kernel = kernels.dead_zone

    def output_range(self, u: Interval) -> Interval:
        lower, upper = self.span("lower"), self.span("upper")
        return Interval(beyond(u.low, lower.high, upper.high), beyond(u.high, lower.low, upper.low))


def beyond(u: float, lower: float, upper: float) -> float:
    """Return the part of u outside [lower, upper], rounded like the kernel; infinity stays infinite."""
    return u - min(max(u, lower), upper) if math.isfinite(u) else u


class PowerLimiter(Block):
    """Limiter of the mechanical power of a joint, driving and braking: limited = clip(τ, ± power / |ω|).

    |limited · ω| is at most `power`, to one rounding. At zero velocity every torque passes. Direct feedthrough. NaN or
    infinity in the torque or the velocity gives NaN.
    """

    power = Param(100.0, "W", "largest magnitude of the power", min=0.0)

    torque = Input("N·m", "requested torque", shape=...)
    velocity = Input("rad/s", "joint velocity ω", shape=...)
    limited = Output("N·m", "limited torque", shape=...)

    kernel = kernels.power

    def output_range(self, torque: Interval, velocity: Interval) -> Interval:
        slowest, power = abs(velocity).low, self.span("power").high
        bound = (power + math.ulp(0.0)) / slowest * (1.0 + 1e-15) if slowest > 0.0 else math.inf
        return (torque | Interval.point(0.0)) & Interval(-bound, bound)


class SoftStop(Block):
    """Spring and damper at each end of a range of motion: stopped = τ - K (θ - upper) - B max(ω, 0), for θ > upper.

    The lower end is symmetric. The damper resists outward motion only. Inside the range the torque passes unchanged.
    Connect a limiter after this block to bound the sum. Direct feedthrough. NaN or infinity in the position or the
    velocity gives NaN; in the torque it passes.
    """

    rules = ("lower < upper",)

    lower = Param(-1.0, "rad", "lower end of the range of motion")
    upper = Param(1.0, "rad", "upper end of the range of motion")
    stiffness = Param(100.0, "N·m/rad", "stiffness K at both ends", min=0.0)
    damping = Param(1.0, "N·m·s/rad", "damping B at both ends", min=0.0)

    torque = Input("N·m", "requested torque")
    position = Input("rad", "joint angle θ")
    velocity = Input("rad/s", "joint velocity ω")
    stopped = Output("N·m", "torque including springs and dampers")

    kernel = kernels.soft_stop

    def output_range(self, torque: Interval, position: Interval, velocity: Interval) -> Interval:
        low, high = torque.low, torque.high
        lower, upper, stiffness, damping = map(self.span, ("lower", "upper", "stiffness", "damping"))
        if position.high > upper.low:  # above `upper`, torque is only subtracted
            farthest = Interval(0.0, (position - upper).high)
            low = min(low, (torque - stiffness * farthest - damping * Interval(0.0, max(0.0, velocity.high))).low)
        if position.low < lower.high:  # below `lower`, torque is only added
            farthest = Interval(0.0, (lower - position).high)
            high = max(high, (torque + stiffness * farthest - damping * Interval(min(0.0, velocity.low), 0.0)).high)
        return Interval(low, high)


class RMSTorqueLimiter(Block):
    """Limiter of the RMS torque over a window, which heats a motor: √(Σ τ² / N) <= limit, N = window / dt.

    Principle: 1. the squares of the last N outputs are stored and summed without drift; 2. the remainder of N limit² is
    the budget; 3. each tick may use 1/M of it, M = fade / dt, so an excessive torque is reduced over about two `fade`
    instead of being cut. The bound holds at every tick, starting with an empty window. |τ| <= limit √(window / fade).
    Put this block last, otherwise its sum is not that of the motor. During missed ticks the last torque counts. Direct
    feedthrough. NaN passes, infinity becomes NaN, neither is held.
    """

    rules = ("fade <= window",)
    held_within = {"limited": ("-limit", "limit")}  # the RMS of a constant torque is its magnitude

    limit = Param(1.0, "N·m", "largest RMS torque, usually the rated torque", min=0.0, max=1e6, required=True)
    window = Param(20.0, "s", "length of the window", above=0.0, fixed=True)
    fade = Param(1.0, "s", "time over which torque is reduced as the budget runs out; 0 cuts it", min=0.0, fixed=True)

    torque = Input("N·m", "requested torque")
    limited = Output("N·m", "limited torque")
    squares = Memory(0.0, "squares of the last outputs")
    sums = Memory((0.0, 0.0), "sum of the squares, and its rounding error")
    place = Memory(0.0, "index of the next square")
    ticks = Memory(1.0, "M = fade / dt")

    clips = True
    kernel = kernels.rms_torque
    examples = (
        {"limit": 9.0},
        {"limit": 2.0, "window": 0.05, "fade": 0.01},
        {"limit": 2.0, "window": 0.05, "fade": 0.0},
    )

    def design(self, dt: float) -> tuple[int, float]:
        """Return (N, M). dt : s"""
        return samples_in(self.window, dt), max(1.0, self.fade / dt)

    def prepare(self, dt: float) -> None:
        count, self.ticks = self.design(dt)
        self.squares = [0.0] * count

    def output_range(self, torque: Interval) -> Interval:
        unlimited, counts = torque | Interval.point(0.0), design_at(self)
        if counts is None:
            return unlimited
        count, ticks = counts
        bound = self.span("limit").high * math.sqrt(count / ticks) + 1e-150  # where squares underflow
        return unlimited & Interval(-bound, bound)


class TemperatureDerating(Block):
    """Torque derating by motor temperature: y = τ · s, s = 1 up to `full`, 0 above `none`, linear between.

    Direct feedthrough. NaN in the torque passes. NaN or infinity in the temperature gives NaN.
    """

    rules = ("full < none",)

    full = Param(80.0, "°C", "temperature up to which the full torque passes")
    none = Param(100.0, "°C", "temperature above which no torque passes")

    torque = Input("N·m", "requested torque", shape=...)
    temperature = Input("°C", "motor temperature")
    derated = Output("N·m", "derated torque", shape=...)

    kernel = kernels.derating

    def output_range(self, torque: Interval, temperature: Interval) -> Interval:
        return torque | Interval.point(0.0)


class SoftStart(Block):
    """Fade-in of a signal: y = u · min(1, t / duration), t since the start or since `enable` became true.

    While `enable` is false the output is 0. Direct feedthrough. NaN in u or `enable` passes.
    """

    duration = Param(1.0, "s", "time until the full signal passes", above=0.0)

    u = Input("any", "input", shape=...)
    enable = Input("1", "false holds the output at 0", dtype=bool, default=True)
    y = Output("any", "faded-in signal", shape=...)
    elapsed = Memory(-1.0, "t in s; negative while disabled")

    kernel = kernels.soft_start

    def output_range(self, u: Interval, enable: Interval) -> Interval:
        return u | Interval.point(0.0)
