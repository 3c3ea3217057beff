"""Statistics over a moving window. Windows count the steps of the block: a missed tick is not a sample."""

from __future__ import annotations

import math

from blocks._plumbing.filter_bounds import HUGE
from cext.kernels import windows as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING

WINDOW_SAMPLES_LIMIT = 1_000_000


def samples_in(window: float, dt: float) -> int:
    """Return the number of samples in a window, rounded to the nearest integer.

    window : s; dt : s. ValueError outside 1 to WINDOW_SAMPLES_LIMIT.
    """
    count = round(window / dt)
    if count < 1:
        raise ValueError(f"a window of {window:g} s is shorter than half a sampling period of {dt:g} s")
    if count > WINDOW_SAMPLES_LIMIT:
        raise ValueError(
            f"a window of {window:g} s has {count} samples at {1 / dt:g} Hz; the limit is {WINDOW_SAMPLES_LIMIT}"
        )
    return count


class _Sums(Block):
    abstract = True
    window = Param(1.0, "s", "length of the window, rounded to an integer number of samples", above=0.0, fixed=True)

    u = Input("any", "input", shape=...)

    def prepare(self, dt: float) -> None:
        samples = samples_in(self.window, dt)
        self.samples = [0.0] * (samples * self.width)
        self.sums = [0.0] * (5 * self.width)


class MovingAverage(_Sums):
    """Mean of the last N inputs: y[k] = (u[k] + ... + u[k-N+1]) / N, N = window / dt.

    The first N - 1 outputs are the mean of the inputs so far. Direct feedthrough. The output is NaN while a NaN or
    infinity is in the window. Exact to a few roundings, without drift. Constant time.
    """

    y = Output("any", "mean over the window", shape=...)
    samples = Memory(0.0, "inputs in the window")
    sums = Memory(0.0, "running and fresh sum of each element, and number of non-finite inputs")
    place = Memory((0.0, 0.0), "index of the next input, and number of inputs")

    smooth = ("u",)
    kernel = kernels.average

    def output_range(self, u: Interval) -> Interval:
        largest = max(abs(u.low), abs(u.high))
        if not WINDOW_SAMPLES_LIMIT * largest < HUGE:  # the sum might overflow
            return EVERYTHING
        # the sum has 106 bits, and the mean is rounded twice
        return Interval(u.low - 1e-15 * largest, u.high + 1e-15 * largest)


class MovingRMS(_Sums):
    """RMS of the last N inputs: y[k] = √((u[k]² + ... + u[k-N+1]²) / N), N = window / dt.

    The first N - 1 outputs are the RMS of the inputs so far. Direct feedthrough. The output is NaN while a NaN, an
    infinity or a square that overflows is in the window. No drift. Constant time.
    """

    y = Output("any", "root mean square over the window", shape=..., range=(0.0, math.inf))
    samples = Memory(0.0, "squares in the window")
    sums = Memory(0.0, "running and fresh sum of each element, and number of non-finite squares")
    place = Memory((0.0, 0.0), "index of the next input, and number of inputs")

    kernel = kernels.rms

    def output_range(self, u: Interval) -> Interval:
        size = abs(u)
        if not WINDOW_SAMPLES_LIMIT * size.high * size.high < HUGE:  # the sum might overflow
            return Interval(0.0)
        # A sum of squares has 106 bits relative to its largest term so far; squares below 1e-300 are lost.
        return Interval(max(0.0, size.low - 1e-9 * size.high) if size.low > 1e-150 else 0.0, size.high * (1.0 + 1e-15))


class _Extreme(Block):
    abstract = True
    window = Param(1.0, "s", "length of the window, rounded to an integer number of samples", above=0.0, fixed=True)

    u = Input("any", "input", shape=...)

    def prepare(self, dt: float) -> None:
        samples = samples_in(self.window, dt)
        self.values = self.steps = [0.0] * (samples * self.width)
        self.queue = (0.0, 0.0, -math.inf) * self.width

    def output_range(self, u: Interval) -> Interval:
        return u


class MovingMaximum(_Extreme):
    """Maximum of the last N inputs: y[k] = max(u[k], ..., u[k-N+1]), N = window / dt.

    The first N - 1 outputs cover the inputs so far. Direct feedthrough. The output is NaN while a NaN or infinity is in
    the window. Amortised constant time, N steps at worst. (Lemire, Streaming maximum-minimum filter, 2006.)
    """

    y = Output("any", "maximum in the window", shape=...)
    values = Memory(0.0, "candidates for the maximum, in decreasing order")
    steps = Memory(0.0, "step of each candidate")
    queue = Memory(0.0, "index of the first candidate, number of candidates, and step of the last NaN")
    now = Memory(0.0, "steps since the start")

    kernel = kernels.maximum


class MovingMinimum(_Extreme):
    """Minimum of the last N inputs: y[k] = min(u[k], ..., u[k-N+1]), N = window / dt.

    The first N - 1 outputs cover the inputs so far. Direct feedthrough. The output is NaN while a NaN or infinity is in
    the window. Amortised constant time, N steps at worst. (Lemire, Streaming maximum-minimum filter, 2006.)
    """

    y = Output("any", "minimum in the window", shape=...)
    values = Memory(0.0, "candidates for the minimum, in increasing order")
    steps = Memory(0.0, "step of each candidate")
    queue = Memory(0.0, "index of the first candidate, number of candidates, and step of the last NaN")
    now = Memory(0.0, "steps since the start")

    kernel = kernels.minimum
