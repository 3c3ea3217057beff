"""Statistics of what an input was during the last so many seconds. Each counts its own steps: a missed tick is no
sample.
"""

import math

from blocks._plumbing.filter_bounds import HUGE
from cext.kernels import windows as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING

LONGEST = 1_000_000  # samples


def samples_in(window, dt):
    """How many samples of period dt, in s, make a window of that many seconds: the nearest whole number, at least
    one.
    """
    count = round(window / dt)
    if count < 1:
        raise ValueError(f"a window of {window:g} s is shorter than half a sampling period of {dt:g} s")
    if count > LONGEST:
        raise ValueError(f"a window of {window:g} s has {count} samples at {1 / dt:g} Hz, and {LONGEST} are the most")
    return count


class _Sums(Block):
    window = Param(1.0, "s", "how far it looks back: the nearest whole number of samples", above=0.0, fixed=True)

    u = Input("any", "input", shape=...)

    def prepare(self, dt):
        samples = samples_in(self.window, dt)
        self.samples = [0.0] * (samples * self.width)
        self.sums = [0.0] * (5 * self.width)


class MovingAverage(_Sums):
    """Mean of the last N inputs: y[k] = (u[k] + ... + u[k-N+1]) / N, N = window / dt.

    Until there are N, the mean of those there are. Direct feedthrough. A NaN or infinity gives NaN for as long as it is
    in the window. Exact to a few roundings however long it runs: no drift. Constant time.
    """

    y = Output("any", "mean over the window", shape=...)
    samples = Memory(0.0, "the inputs in the window")
    sums = Memory(0.0, "running and fresh sum of each element, and how many inputs are not finite")
    place = Memory((0.0, 0.0), "where the next input goes, and how many there are")

    kernel = kernels.average

    def output_range(self, u):
        largest = max(abs(u.low), abs(u.high))
        if not LONGEST * largest < HUGE:  # the sum might overflow
            return EVERYTHING
        # the sum keeps 106 bits, the mean is rounded twice
        return Interval(u.low - 1e-15 * largest, u.high + 1e-15 * largest)


class MovingRMS(_Sums):
    """Root of the mean square of the last N inputs: y[k] = √((u[k]² + ... + u[k-N+1]²) / N), N = window / dt.

    Until there are N, of those there are. Direct feedthrough. A NaN, an infinity or a square that overflows gives NaN
    for as long as it is in the window. No drift. Constant time.
    """

    y = Output("any", "root mean square over the window", shape=..., range=(0.0, math.inf))
    samples = Memory(0.0, "the squares in the window")
    sums = Memory(0.0, "running and fresh sum of each element, and how many squares are not finite")
    place = Memory((0.0, 0.0), "where the next input goes, and how many there are")

    kernel = kernels.rms

    def output_range(self, u):
        size = abs(u)
        if not LONGEST * size.high * size.high < HUGE:  # the sum might overflow
            return Interval(0.0)
        # A sum of squares keeps 106 bits of the largest that was in it; squares below 1e-300 are lost.
        return Interval(max(0.0, size.low - 1e-9 * size.high) if size.low > 1e-150 else 0.0, size.high * (1.0 + 1e-15))


class _Extreme(Block):
    window = Param(1.0, "s", "how far it looks back: the nearest whole number of samples", above=0.0, fixed=True)

    u = Input("any", "input", shape=...)

    def prepare(self, dt):
        samples = samples_in(self.window, dt)
        self.values = self.steps = [0.0] * (samples * self.width)
        self.queue = (0.0, 0.0, -math.inf) * self.width

    def output_range(self, u):
        return u


class MovingMaximum(_Extreme):
    """Largest of the last N inputs: y[k] = max(u[k], ..., u[k-N+1]), N = window / dt.

    Until there are N, of those there are. Direct feedthrough. A NaN or infinity gives NaN for as long as it is in the
    window. Amortised constant time, N steps at worst. (Lemire, Streaming maximum-minimum filter, 2006.)
    """

    y = Output("any", "largest in the window", shape=...)
    values = Memory(0.0, "inputs that may yet be the largest, in falling order")
    steps = Memory(0.0, "when each came")
    queue = Memory(0.0, "where they begin, how many there are, and when the last NaN came")
    now = Memory(0.0, "steps since the start")

    kernel = kernels.maximum


class MovingMinimum(_Extreme):
    """Smallest of the last N inputs: y[k] = min(u[k], ..., u[k-N+1]), N = window / dt.

    Until there are N, of those there are. Direct feedthrough. A NaN or infinity gives NaN for as long as it is in the
    window. Amortised constant time, N steps at worst. (Lemire, Streaming maximum-minimum filter, 2006.)
    """

    y = Output("any", "smallest in the window", shape=...)
    values = Memory(0.0, "inputs that may yet be the smallest, in rising order")
    steps = Memory(0.0, "when each came")
    queue = Memory(0.0, "where they begin, how many there are, and when the last NaN came")
    now = Memory(0.0, "steps since the start")

    kernel = kernels.minimum
