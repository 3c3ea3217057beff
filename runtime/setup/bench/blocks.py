"""Chains of blocks: cost of native and Python blocks per tick, and growth of the time of a compile."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from blocks.limiters import Saturation
from blocks.mathematics import Gain, Sum
from blocks.sources import Constant, Sine
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, Param, Sink, compile
from runtime.host.console.progress import rounds
from runtime.setup.bench.measure import Times

RATE = 1000.0  # Hz
GROUPS = 33  # of gain, saturation and difference in the chain whose ticks are timed
COMPILE_REPEATS = {65: 9, 330: 5, 3330: 3}  # {groups: compiles}: 198, 993 and 9993 blocks


class End(Sink):
    """End of a chain."""

    u = Input("any", "any signal")
    variadic = False


class PythonGain(Block):
    """Gain in Python: y = gain u."""

    gain = Param(1.0, "any")
    u = Input("any")
    y = Output("any")

    def step(self, u):
        return self.gain * u


class PythonSaturation(Block):
    """Saturation in Python: y = min(max(u, lower), upper)."""

    lower, upper = Param(-1.0, "any"), Param(1.0, "any")
    u = Input("any")
    y = Output("any")

    def step(self, u):
        return self.lower if u < self.lower else self.upper if u > self.upper else u


class PythonDifference(Block):
    """Difference in Python: y = a - b."""

    a, b = Input("any"), Input("any")
    y = Output("any")

    def step(self, a, b):
        return a - b


NATIVE = (Gain, Saturation, lambda: Sum("+-"))
PYTHON = (PythonGain, PythonSaturation, PythonDifference)


def chain(kinds: tuple[type[Block], type[Block], Callable[..., Any] | type[Block]], groups: int = GROUPS) -> Diagram:
    """Build a diagram of a sine, then groups of gain, saturation and difference. kinds : NATIVE or PYTHON"""
    gain, saturation, difference = kinds
    with Diagram("chain", RATE) as diagram:
        offset, signal = Constant(0.001)(), Sine()()
        for _ in range(groups):
            signal = difference()(saturation()(gain(1.01)(signal)), offset)
        End()(signal)
    return diagram


class Ticks:
    """Ticks of a compiled diagram without a clock. Each call of `advance` starts at tick 0."""

    def __init__(self, name: str, diagram: Diagram) -> None:
        self.name, self.blocks = name, len(diagram)
        self.program = Program(compile(diagram))
        self.executor = Executor(self.program, RATE)

    def restart(self) -> None:
        """Do nothing: each call of `advance` starts at tick 0."""

    def advance(self, ticks: int) -> float:
        """Run so many ticks. Returns the processor time of this thread, in s."""
        return self.executor.spin(ticks) * 1e-9


class Compiles:
    """Times of one diagram, in ms: `build` makes and wires its `blocks`, `compile` compiles them."""

    def __init__(self, groups: int, repeats: int) -> None:
        built, compiled = [], []
        for _ in rounds("compiling", repeats):
            start = time.thread_time()
            diagram = chain(NATIVE, groups)
            wired = time.thread_time()
            compile(diagram)
            compiled.append((time.thread_time() - wired) * 1e3)
            built.append((wired - start) * 1e3)
            self.blocks = len(diagram)
        self.build, self.compile = Times(built), Times(compiled)


def compiles() -> list[Compiles]:
    """Measure compiles. Returns [Compiles], smallest diagram first; its first round includes one-time costs."""
    return [Compiles(groups, repeats) for groups, repeats in COMPILE_REPEATS.items()]


def exponent(smaller: Compiles, larger: Compiles) -> float:
    """Return p of a time that grows as blocks to the power p."""
    return math.log(larger.compile.least / smaller.compile.least) / math.log(larger.blocks / smaller.blocks)


def n_log_n(smaller: Compiles, larger: Compiles) -> float:
    """Return the same p for a time that grows as n log n."""
    more, less = (size.blocks * math.log(size.blocks) for size in (larger, smaller))
    return math.log(more / less) / math.log(larger.blocks / smaller.blocks)
