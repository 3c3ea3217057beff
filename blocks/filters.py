"""Causal filters."""

from __future__ import annotations

import math
from typing import Any

from blocks._plumbing import biquads
from blocks._plumbing.biquads import Biquads
from blocks._plumbing.filter_bounds import HUGE, with_zero
from cext.kernels import filters as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING
from graph.narrowing import is_row, is_tuple

_EDGE = Param(10.0, "Hz", above=0.0)


class _Edges(Param[Any]):
    """Parameter that is a frequency or a pair of frequencies."""

    def check(self, value: Any) -> Any:
        if is_row(value):
            edges = tuple(_EDGE.check(edge) for edge in value)
            return edges if len(edges) > 1 else _EDGE.check(value)
        return _EDGE.check(value)

    def parse(self, text: str) -> Any:
        edges = [_EDGE.parse(part.strip()) for part in text.split(",")]
        return tuple(edges) if len(edges) > 1 else edges[0]


class Butterworth(Biquads):
    """Butterworth filter: low-pass |H(f)|² = 1 / (1 + (f / cutoff)^(2 order)).

    Bilinear transform with prewarping (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1). `btype` and
    `cutoff` are those of scipy.signal.butter: "lowpass" and "highpass" require one frequency, "bandpass" and "bandstop"
    a pair, with twice as many poles. Direct feedthrough. The state starts at zero; after arming it starts in steady
    state for the present input, which avoids an initial transient. NaN passes and persists until the next reset. The
    output can overshoot the input: its range follows from the 1-norm of the impulse response.
    """

    order = Param(2, "1", "number of poles; half the number for band filters", min=1, max=8, fixed=True)
    cutoff = _Edges(10.0, "Hz", "frequency at which the gain is 1/√2, or a pair of frequencies", dtype=object)
    btype = Param("lowpass", "1", "pass band", choices=("lowpass", "highpass", "bandpass", "bandstop"))

    def configure(self) -> None:
        edges = self.cutoff if is_tuple(self.cutoff) else (self.cutoff,)
        if self.btype in ("lowpass", "highpass") and len(edges) != 1:
            raise ValueError(f"cutoff: a {self.btype} filter requires one frequency in Hz, got {self.cutoff!r}")
        if self.btype in ("bandpass", "bandstop") and (len(edges) != 2 or not edges[0] < edges[1]):
            raise ValueError(
                f"cutoff: a {self.btype} filter requires an increasing pair of frequencies in Hz, (low, high), "
                f"got {self.cutoff!r}"
            )

    def design(self, dt: float) -> list[tuple[float, ...]]:
        """Return the biquads (b0, b1, b2, a1, a2). dt : s

        Raises ValueError for a cutoff at or above half the rate.
        """
        check_frequency("a cutoff", max(self.cutoff) if is_tuple(self.cutoff) else self.cutoff, dt)
        return biquads.butterworth(self.order, self.cutoff, self.btype, dt)


class Notch(Biquads):
    """Notch filter: H(s) = (s² + ω₀²) / (s² + (ω₀ / q) s + ω₀²).

    Bilinear transform, as in scipy.signal.iirnotch. Direct feedthrough. The state starts at zero; after arming it
    starts in steady state for the present input. NaN passes and persists until the next reset.
    """

    frequency = Param(50.0, "Hz", "notch frequency: 50 or 60 Hz for mains hum", above=0.0, fixed=True)
    q = Param(30.0, "1", "quality factor: the frequency divided by the -3 dB bandwidth", above=0.0, fixed=True)

    def design(self, dt: float) -> list[tuple[float, ...]]:
        """Return the biquad (b0, b1, b2, a1, a2). dt : s

        Raises ValueError for a frequency or a bandwidth that is too high for the rate.
        """
        check_frequency("a frequency", self.frequency, dt)
        if self.frequency / self.q * dt >= 0.5:
            raise ValueError(
                f"q: the bandwidth of {self.frequency / self.q:g} Hz must be below half the rate, {0.5 / dt:g} Hz"
            )
        return [biquads.notch(self.frequency, self.q, dt)]


def check_frequency(what: str, frequency: float, dt: float) -> None:
    """Raise ValueError unless the frequency in Hz is below half the rate."""
    if frequency * dt >= 0.5:
        raise ValueError(f"{what} of {frequency:g} Hz requires a rate above {2 * frequency:g} Hz, got {1 / dt:g} Hz")


class Exponential(Block):
    """First-order low-pass, or exponential smoothing: y[k] = y[k-1] + α (u[k] - y[k-1]), α = dt / (τ + dt).

    Backward difference of τ dy/dt = u - y. Direct feedthrough. Starts at the first input, and never leaves the interval
    of the inputs. dt is the actual time since the previous step, so missed ticks do not slow the filter. NaN and
    infinity pass and are not held.
    """

    time_constant = Param(0.05, "s", "time constant τ, after which the output has reached 63 % of a step", above=0.0)

    u = Input("any", "raw signal", shape=...)
    y = Output("any", "filtered signal", shape=...)
    state = Memory(math.nan, "output of the previous tick")

    smooth = ("u",)
    kernel = kernels.exponential

    def prepare(self, dt: float) -> None:
        self.state = [math.nan] * self.width

    def output_range(self, u: Interval) -> Interval:
        return u


class Median(Block):
    """Median of the last N inputs: y[k] = median(u[k], ..., u[k-N+1]), N = samples.

    Removes outliers and preserves edges, with a delay of (N - 1) / 2 ticks. The first N - 1 outputs are the median of
    the inputs so far (the mean of the middle two for an even number). Direct feedthrough. The output is NaN while a NaN
    or infinity is in the window.
    """

    samples = Param(3, "1", "window length N, an odd number", min=1, max=9999, fixed=True)

    u = Input("any", "raw signal", shape=...)
    y = Output("any", "filtered signal", shape=...)
    ring = Memory(0.0, "inputs in the window")
    ordered = Memory(0.0, "the same inputs in increasing order, without NaN")
    place = Memory(0.0, "index of the next input")
    counts = Memory(0.0, "counts of numbers and of NaN in the window, per element")

    kernel = kernels.median

    def configure(self) -> None:
        if self.samples % 2 == 0:
            raise ValueError(f"samples: must be odd, got {self.samples}")

    def prepare(self, dt: float) -> None:
        self.ring = self.ordered = [0.0] * (self.samples * self.width)
        self.counts = [0.0] * (2 * self.width)

    def output_range(self, u: Interval) -> Interval:
        return u


class Complementary(Block):
    """Complementary filter of gyroscope and accelerometer: τ dθ/dt = (angle - θ) + τ · rate.   (Higgins 1975)

    Backward difference, θ[k] = (τ (θ[k-1] + dt · rate) + dt · angle) / (τ + dt). Direct feedthrough. Starts at the
    first angle. A gyroscope bias b causes an error of τ b. NaN or infinity in either input passes and is not held.
    """

    time_constant = Param(0.5, "s", "time constant τ: the angle dominates below 1/(2π τ), the rate above", above=0.0)

    rate = Input("rad/s", "angular rate of the gyroscope", shape=...)
    angle = Input("rad", "angle of the accelerometer", shape=...)
    fused = Output("rad", "estimated angle θ", shape=...)
    state = Memory(math.nan, "output of the previous tick")

    kernel = kernels.complementary

    def prepare(self, dt: float) -> None:
        self.state = [math.nan] * self.width

    def output_range(self, rate: Interval, angle: Interval) -> Interval:
        slow = self.span("time_constant").high
        exact = angle + Interval.point(slow) * with_zero(rate)
        largest = max(abs(exact.low), abs(exact.high))
        if self.dt is None or not largest * (1.0 + slow) < HUGE:
            return EVERYTHING
        rounding = 1e-15 * (1.0 + slow / self.dt) * largest  # of each step, which decays over τ / dt steps
        return Interval(exact.low - rounding, exact.high + rounding)
