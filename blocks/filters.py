"""Filters. Each is causal: what it takes away from the signal it pays for in delay."""

import math
from typing import Any

from blocks._plumbing import biquads
from blocks._plumbing.biquads import Biquads
from blocks._plumbing.filter_bounds import HUGE, with_zero
from cext.kernels import filters as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING

_EDGE = Param(10.0, "Hz", above=0.0)


class _Edges(Param[Any]):
    """A frequency, or a pair of them."""

    def check(self, value):
        if isinstance(value, (tuple, list)):
            return tuple(_EDGE.check(edge) for edge in value)
        return _EDGE.check(value)

    def parse(self, text):
        found = [_EDGE.parse(part.strip()) for part in text.split(",")]
        return tuple(found) if len(found) > 1 else found[0]


class Butterworth(Biquads):
    """Maximally flat pass band: low-pass |H(f)|² = 1 / (1 + (f / cutoff)^(2 order)), by the bilinear transform with
    prewarping.

    `btype` and `cutoff` are those of scipy.signal.butter: "lowpass" and "highpass" take one frequency, "bandpass" and
    "bandstop" a pair, with twice as many poles. (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1.) Direct
    feedthrough. The filter starts at zero; when a robot has been armed it starts at its present input, so that the
    first tick does not kick. NaN passes and stays until the next reset. Its output can overshoot its input: the range
    is that of the 1-norm of the impulse response.
    """

    order = Param(2, "1", "number of poles, and half of them for a band", min=1, max=8, fixed=True)
    cutoff = _Edges(10.0, "Hz", "frequency where the gain is 1/√2, or a pair of them", dtype=object)
    btype = Param("lowpass", "1", "what passes", choices=("lowpass", "highpass", "bandpass", "bandstop"))

    def configure(self):
        edges = self.cutoff if isinstance(self.cutoff, tuple) else (self.cutoff,)
        if self.btype in ("lowpass", "highpass") and len(edges) != 1:
            raise ValueError(f"cutoff: a {self.btype} filter takes one frequency in Hz, got {self.cutoff!r}")
        if self.btype in ("bandpass", "bandstop") and (len(edges) != 2 or not edges[0] < edges[1]):
            raise ValueError(
                f"cutoff: a {self.btype} filter takes a rising pair of frequencies in Hz, (low, high), "
                f"got {self.cutoff!r}"
            )

    def design(self, dt):
        check_frequency("a cutoff", max(self.cutoff) if isinstance(self.cutoff, tuple) else self.cutoff, dt)
        return biquads.butterworth(self.order, self.cutoff, self.btype, dt)


class Notch(Biquads):
    """Removes one frequency: H(s) = (s² + ω₀²) / (s² + (ω₀ / q) s + ω₀²), by the bilinear transform, as
    scipy.signal.iirnotch has it.

    Direct feedthrough. Starts at zero, or at its present input when a robot has been armed. NaN passes and stays until
    the next reset.
    """

    frequency = Param(50.0, "Hz", "what is removed: 50 or 60 Hz for mains hum", above=0.0, fixed=True)
    q = Param(30.0, "1", "quality: the frequency over the bandwidth at -3 dB", above=0.0, fixed=True)

    def design(self, dt):
        check_frequency("a frequency", self.frequency, dt)
        if self.frequency / self.q * dt >= 0.5:
            raise ValueError(
                f"q: a bandwidth of {self.frequency / self.q:g} Hz is not below half the rate, {0.5 / dt:g} Hz"
            )
        return [biquads.notch(self.frequency, self.q, dt)]


def check_frequency(what, frequency, dt):
    """Raise ValueError for a frequency, in Hz, at or above half the rate 1 / dt."""
    if frequency * dt >= 0.5:
        raise ValueError(
            f"{what} of {frequency:g} Hz needs a rate above {2 * frequency:g} Hz, and this is {1 / dt:g} Hz"
        )


class Exponential(Block):
    """First-order low-pass, or exponential smoothing: y[k] = y[k-1] + α (u[k] - y[k-1]), α = dt / (time_constant + dt).

    The backward difference of τ dy/dt = u - y. Direct feedthrough. Starts at its first input, and never leaves the
    interval of its inputs. dt is the true time since the step before, so missed ticks do not slow it. NaN and infinity
    pass and are not held.
    """

    time_constant = Param(0.05, "s", "τ: 63 % of a step is reached after it", above=0.0)

    u = Input("any", "raw", shape=...)
    y = Output("any", "filtered", shape=...)
    state = Memory(math.nan, "output of the tick before")

    kernel = kernels.exponential

    def prepare(self, dt):
        self.state = [math.nan] * self.width

    def output_range(self, u):
        return u


class Median(Block):
    """Middle one of the last N inputs in order, y[k] = median(u[k], ..., u[k-N+1]), N = samples: takes out outliers and
    keeps edges.

    What it shows is (N - 1) / 2 ticks late. Until there are that many, of those there are; the mean of the middle two
    where their number is even. Direct feedthrough. A NaN or infinity gives NaN for as long as it is in the window.
    """

    samples = Param(3, "1", "how many inputs: an odd number", min=1, max=9999, fixed=True)

    u = Input("any", "raw", shape=...)
    y = Output("any", "filtered", shape=...)
    ring = Memory(0.0, "the inputs in the window")
    ordered = Memory(0.0, "the same in rising order, without NaN")
    place = Memory(0.0, "where the next input goes")
    counts = Memory(0.0, "of numbers and of NaN in the window of each element")

    kernel = kernels.median

    def configure(self):
        if self.samples % 2 == 0:
            raise ValueError(f"samples: must be odd, got {self.samples}")

    def prepare(self, dt):
        self.ring = self.ordered = [0.0] * (self.samples * self.width)
        self.counts = [0.0] * (2 * self.width)

    def output_range(self, u):
        return u


class Complementary(Block):
    """Angle from a gyroscope for what is fast and from an accelerometer for what is slow: τ dθ/dt = (angle - θ) + τ ·
    rate.

    The backward difference, θ[k] = (τ (θ[k-1] + dt · rate) + dt · angle) / (τ + dt). Direct feedthrough. Starts at its
    first angle. A gyroscope that is off by b leaves an error of τ b. NaN or infinity in either passes and is not held.
    (Higgins, A comparison of complementary and Kalman filtering, 1975.)
    """

    time_constant = Param(0.5, "s", "τ: below 1/(2π τ) the angle counts, above it the rate", above=0.0)

    rate = Input("rad/s", "from the gyroscope", shape=...)
    angle = Input("rad", "from the accelerometer", shape=...)
    fused = Output("rad", "θ", shape=...)
    state = Memory(math.nan, "output of the tick before")

    kernel = kernels.complementary

    def prepare(self, dt):
        self.state = [math.nan] * self.width

    def output_range(self, rate, angle):
        slow = self.span("time_constant").high
        found = angle + Interval.point(slow) * with_zero(rate)
        largest = max(abs(found.low), abs(found.high))
        if self.dt is None or not largest * (1.0 + slow) < HUGE:
            return EVERYTHING
        more = 1e-15 * (1.0 + slow / self.dt) * largest  # the rounding of each step, which is felt for τ / dt steps
        return Interval(found.low - more, found.high + more)
