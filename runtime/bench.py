"""`python -m runtime bench`: what a tick and a block cost here, beside the same computation as a plain Python function."""

import math
import platform
import statistics
import time

from cext.executor import Executor
from cext.program import Program

from blocks.limiters import Saturation
from blocks.mathematics import Gain, Sum
from blocks.sources import Sine
from graph import Block, Diagram, Input, Output, compile

GROUPS = 33                     # of gain, saturation and sum, behind one sine: 100 blocks
RATE = 1000.0


class PythonSine(Block):
    """The same wave as Sine(1.0, 1.0), in Python."""

    y = Output("any")

    def step(self, t):
        return math.sin(6.283185307179586 * t)


class PythonGain(Block):
    """y = 1.01 u, in Python."""

    u = Input("any")
    y = Output("any")

    def reset(self):
        self.gain = 1.01

    def step(self, u):
        return self.gain * u


class PythonSaturation(Block):
    """u between -1 and 1, in Python."""

    u = Input("any")
    y = Output("any")

    def step(self, u):
        return -1.0 if u < -1.0 else 1.0 if u > 1.0 else u


class PythonSum(Block):
    """y = a - b, in Python."""

    a = Input("any")
    b = Input("any")
    y = Output("any")

    def step(self, a, b):
        return a - b


def native_chain():
    with Diagram("native", RATE) as diagram:
        u = Sine(1.0, 1.0)()
        for _ in range(GROUPS):
            u = Sum("+-")(Saturation(-1.0, 1.0)(Gain(1.01)(u)), 0.001)
    return diagram, u


def python_chain():
    with Diagram("python", RATE) as diagram:
        u = PythonSine()()
        for _ in range(GROUPS):
            u = PythonSum()(PythonSaturation()(PythonGain()(u)), 0.001)
    return diagram, u


def plain_function():
    """The same 100 computations as one straight-line function of t."""
    lines = ["def tick(t):", "    u = sin(6.283185307179586 * t)"]
    lines += ["    u = 1.01 * u", "    u = -1.0 if u < -1.0 else 1.0 if u > 1.0 else u", "    u = u - 0.001"] * GROUPS
    namespace = {"sin": math.sin}
    exec("\n".join([*lines, "    return u"]), namespace)
    return namespace["tick"]


class Chain:
    """A diagram ready to spin: `seconds(n)` is how long n ticks take, `value` what came out of the last."""

    def __init__(self, diagram, signal):
        schedule = compile(diagram)
        self.program = Program(schedule)
        self.executor = Executor(self.program, RATE)
        self.slot = schedule.signals[signal.path].slot

    def seconds(self, ticks):
        return self.executor.spin(ticks) * 1e-9

    @property
    def value(self):
        return self.program.values[self.slot]


class Plain:
    """The plain function, timed the same way."""

    def __init__(self):
        self.tick = plain_function()

    def seconds(self, ticks):
        tick, value = self.tick, 0.0
        began = time.perf_counter()
        for k in range(ticks):
            value = tick(k / RATE)
        self.value = value
        return time.perf_counter() - began


def bench(seconds, repeats):
    """Lines of ns per tick and block: minimum, median and maximum of `repeats` measurements of about `seconds` each, taken in turn."""
    blocks = 1 + 3 * GROUPS
    rows = {"native blocks": Chain(*native_chain()), "Python blocks": Chain(*python_chain()), "plain Python function": Plain()}
    check_equal(rows)
    ticks = {name: calibrate(row, seconds) for name, row in rows.items()}
    found = {name: [] for name in rows}
    for _ in range(repeats):
        for name, row in rows.items():
            found[name].append(row.seconds(ticks[name]) / ticks[name] * 1e9)
    lines = [
        f"a chain of {blocks} blocks, one thread, no sleeping; {repeats} measurements of {seconds:g} s each, taken in turn",
        f"Python {platform.python_version()} on {platform.machine()}",
        f"{'':22}{'ns a tick:  min':>18}{'median':>10}{'max':>10}{'ns a block:  min':>20}{'median':>10}",
    ]
    for name, values in found.items():
        least, median, most = min(values), statistics.median(values), max(values)
        lines.append(f"{name:22}{least:18.0f}{median:10.0f}{most:10.0f}{least / blocks:20.2f}{median / blocks:10.2f}")
    return lines


def check_equal(rows):
    """All rows must compute the same before their times are compared."""
    for row in rows.values():
        row.seconds(123)
    values = [row.value for row in rows.values()]
    if max(values) != min(values):
        raise AssertionError(f"the rows disagree: {values}")


def calibrate(row, seconds):
    ticks = 10
    while row.seconds(ticks) < 0.2 * seconds:
        ticks *= 2
    return max(1, round(ticks * seconds / row.seconds(ticks)))
