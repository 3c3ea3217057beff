"""Limiters: what stands between a controller and a person. NaN passes and infinity becomes NaN, which is a fault at the
actuator.
"""

import math

from blocks._plumbing.filter_bounds import designed
from blocks.windows import samples_in
from cext.kernels import limiters as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class Saturation(Block):
    """Clips: y = min(max(u, lower), upper). Direct feedthrough; NaN passes and infinity becomes NaN."""

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
        if lower.high > upper.low:  # live bounds that may cross
            return lower | upper
        return Interval(min(max(u.low, lower.low), upper.low), min(max(u.high, lower.high), upper.high))


class SlewRate(Block):
    """Follows the input at a bounded rate: |y[k] - y[k-1]| <= rate · dt.

    Starts at zero, or at the present input when armed. Direct feedthrough; NaN passes, infinity becomes NaN, and
    neither is held.
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

    Principle: 1. the input is clipped to ± limit; 2. the output moves toward it by at most slew · dt, so it never
    leaves the interval that holds both. Where no slew is given, the torque crosses the whole range in 0.1 s: slew = 20
    limit per second, of the limit as it is now where that is live; `slew=math.inf` asks for none. A limit lowered while
    running holds at once. Starts at zero. NaN passes, infinity becomes NaN, neither is held, and both are a fault at
    the actuator.
    """

    limit = Param(1.0, "N·m", "largest torque, either way", min=0.0, required=True)
    slew = Param(
        None, "N·m/s", "fastest change, either way; the whole range in 0.1 s if left out", min=0.0, dtype=float
    )

    torque = Input("N·m", "asked for")
    limited = Output("N·m", "let through")
    previous = Memory(0.0, "output of the tick before")

    kernel = kernels.torque_limiter
    examples = ({"limit": 12.0}, {"limit": 12.0, "slew": 200.0})

    def output_range(self, torque):
        return Interval(-self.span("limit").high, self.span("limit").high)

    @property
    def output_slew(self):
        """The fastest change in N·m/s: the slew, or what the largest limit gives."""
        return 20.0 * self.span("limit").high if self.slew is None else self.span("slew").high


class DeadZone(Block):
    """Lets nothing small through: y = u - lower below lower, 0 between, u - upper above. NaN passes, infinity becomes
    NaN.
    """

    lower = Param(-1.0, "any", "where the zone begins")
    upper = Param(1.0, "any", "where it ends")

    u = Input("any", "input", shape=...)
    y = Output("any", "what exceeds the zone", shape=...)

    kernel = kernels.dead_zone

    def configure(self):
        if self.lower > self.upper:
            raise ValueError(f"lower, {self.lower:g}, is above upper, {self.upper:g}")

    def output_range(self, u):
        lower, upper = self.span("lower"), self.span("upper")
        if lower.high > upper.low:  # live ends that may cross
            return u - (lower | upper)
        return Interval(beyond(u.low, lower.high, upper.high), beyond(u.high, lower.low, upper.low))


def beyond(u, lower, upper):
    """What of u lies outside [lower, upper], as the kernel computes it; an infinite end stays."""
    return u - min(max(u, lower), upper) if math.isfinite(u) else u


class PowerLimiter(Block):
    """Bounds the mechanical power of a joint, driving and braking: |τ ω| <= power, to one rounding.

    At rest every torque passes. Direct feedthrough. NaN or infinity in the torque or the velocity gives NaN.
    """

    power = Param(100.0, "W", "largest power, either way", min=0.0)

    torque = Input("N·m", "asked for", shape=...)
    velocity = Input("rad/s", "of the joint, ω", shape=...)
    limited = Output("N·m", "let through", shape=...)

    kernel = kernels.power

    def output_range(self, torque, velocity):
        slowest, power = abs(velocity).low, self.span("power").high
        most = (power + math.ulp(0.0)) / slowest * (1.0 + 1e-15) if slowest > 0.0 else math.inf
        return (torque | Interval.point(0.0)) & Interval(-most, most)


class SoftStop(Block):
    """A spring and a damper at each end of a range of motion: τ -= K (θ - upper) + B ω beyond upper, and so at lower.

    The damper resists what moves further out and lets what comes back go. Inside the range the torque passes as it is.
    A limiter behind it bounds the sum. Direct feedthrough. NaN or infinity in the position or the velocity gives NaN,
    in the torque passes.
    """

    lower = Param(-1.0, "rad", "where motion ends")
    upper = Param(1.0, "rad", "where motion ends")
    stiffness = Param(100.0, "N·m/rad", "K", min=0.0)
    damping = Param(1.0, "N·m·s/rad", "B", min=0.0)

    torque = Input("N·m", "asked for")
    position = Input("rad", "joint angle θ")
    velocity = Input("rad/s", "joint velocity ω")
    stopped = Output("N·m", "with what the ends add")

    kernel = kernels.soft_stop

    def configure(self):
        if self.lower >= self.upper:
            raise ValueError(f"lower, {self.lower:g} rad, is not below upper, {self.upper:g} rad")

    def output_range(self, torque, position, velocity):
        low, high = torque.low, torque.high
        lower, upper, stiffness, damping = map(self.span, ("lower", "upper", "stiffness", "damping"))
        if position.high > upper.low:  # beyond upper torque is only taken away
            farthest = Interval(0.0, (position - upper).high)
            low = min(low, (torque - stiffness * farthest - damping * Interval(0.0, max(0.0, velocity.high))).low)
        if position.low < lower.high:  # and below lower only added
            farthest = Interval(0.0, (lower - position).high)
            high = max(high, (torque + stiffness * farthest - damping * Interval(min(0.0, velocity.low), 0.0)).high)
        return Interval(low, high)


class RMSTorqueLimiter(Block):
    """Bounds the root mean square of a torque over a window, which is what heats a motor: √(Σ τ² / N) <= limit, N =
    window / dt.

    Principle: 1. the squares of the last N outputs are kept and summed without drift; 2. what N limit² still allows is
    the budget; 3. a tick may take 1/M of it, M = fade / dt, so that a torque that asks for too much is taken back over
    about two `fade` rather than cut. The bound holds at every tick, from an empty window on. |τ| <= limit √(window /
    fade). Put it last, or its sum is not that of the motor. Through missed ticks the last torque counts. Direct
    feedthrough. NaN passes, infinity becomes NaN, neither is held.
    """

    limit = Param(1.0, "N·m", "largest root mean square: the rated torque", min=0.0, max=1e6, required=True)
    window = Param(20.0, "s", "over which it is taken", above=0.0, fixed=True)
    fade = Param(1.0, "s", "how gently torque is taken back as the budget runs out; 0 cuts it", min=0.0, fixed=True)

    torque = Input("N·m", "asked for")
    limited = Output("N·m", "let through")
    squares = Memory(0.0, "of the last outputs")
    sums = Memory((0.0, 0.0), "sum of the squares, and what rounding lost of it")
    place = Memory(0.0, "where the next square goes")
    ticks = Memory(1.0, "M")

    kernel = kernels.rms_torque
    examples = (
        {"limit": 9.0},
        {"limit": 2.0, "window": 0.05, "fade": 0.01},
        {"limit": 2.0, "window": 0.05, "fade": 0.0},
    )

    def configure(self):
        if self.fade > self.window:
            raise ValueError(f"fade, {self.fade:g} s, is longer than the window, {self.window:g} s")

    def design(self, dt):
        """(N, M)"""
        return samples_in(self.window, dt), max(1.0, self.fade / dt)

    def prepare(self, dt):
        count, self.ticks = self.design(dt)
        self.squares = [0.0] * count

    def output_range(self, torque):
        found, counts = torque | Interval.point(0.0), designed(self)
        if counts is None:
            return found
        count, ticks = counts
        most = self.span("limit").high * math.sqrt(count / ticks) + 1e-150  # where squares underflow
        return found & Interval(-most, most)


class TemperatureDerating(Block):
    """Takes torque back as a motor gets hot: y = τ · s, s = 1 up to `full`, 0 from `none` on, and straight between.

    Direct feedthrough. NaN in the torque passes. NaN or infinity in the temperature gives NaN.
    """

    full = Param(80.0, "°C", "up to here torque passes in full")
    none = Param(100.0, "°C", "from here on none passes")

    torque = Input("N·m", "asked for", shape=...)
    temperature = Input("°C", "of the motor")
    derated = Output("N·m", "let through", shape=...)

    kernel = kernels.derating

    def configure(self):
        if self.full >= self.none:
            raise ValueError(f"full, {self.full:g} °C, is not below none, {self.none:g} °C")

    def output_range(self, torque, temperature):
        return torque | Interval.point(0.0)


class SoftStart(Block):
    """Fades a signal in: y = u · min(1, t / duration), t since the start or since `enable` became true.

    While `enable` is false the output is 0. Direct feedthrough. NaN in u or `enable` passes.
    """

    duration = Param(1.0, "s", "until the whole signal passes", above=0.0)

    u = Input("any", "input", shape=...)
    enable = Input("1", "whether it may pass at all", dtype=bool, default=True)
    y = Output("any", "faded in", shape=...)
    elapsed = Memory(-1.0, "t, in s; negative while it is not enabled")

    kernel = kernels.soft_start

    def output_range(self, u, enable):
        return u | Interval.point(0.0)
