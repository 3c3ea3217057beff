"""Warnings of torques that a disabled subsystem holds and that reach an actuator."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

from graph.device import Actuator, Device
from graph.interval import EVERYTHING, Interval
from graph.ranges import interval_of_numbers
from graph.rate_checks import names_of
from graph.rules import held_bounds_of
from graph.signal import Signal
from graph.units import ANY
from graph.upstream import followers_of

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block
    from graph.compilation import Compilation

DEPTH = 8  # of blocks between a condition and what selects by it
ONE = Interval.point(1.0)


def check_held(compilation: Compilation) -> None:
    """Warn of each output that its subsystem, while disabled, holds in the command of an actuator."""
    starts = [Signal(block, name) for block in compilation.blocks if block.conditions for name in block.outputs]
    followers = followers_of(compilation.sources) if starts else {}
    conditions = {condition for start in starts for condition in start.block.conditions}
    paths = {condition: HeldPaths(compilation, followers, condition) for condition in conditions}
    for start in starts:
        reached: dict[tuple[Block, str], list[Signal]] = {}
        for condition in start.block.conditions:
            for command in paths[condition].commands(start):
                reached.setdefault(command, []).append(condition)
        late = late_parameters(compilation, start) if reached else []
        for (block, name), false in reached.items():
            compilation.report(
                "TW021",
                f"{start.path} keeps its last value while {names_of(tuple(false))} is false"
                + (f"; live changes of {', '.join(late)} take effect when it is true again" if late else ""),
                block,
                name,
                compilation.where(block, name),
                "connect a Switch after the subsystem that selects 0 while it is disabled",
                "warning",
            )


class HeldPaths:
    """The ways from held outputs to actuators while a condition is false."""

    def __init__(
        self, compilation: Compilation, followers: dict[Signal, list[tuple[Block, str]]], condition: Signal
    ) -> None:
        self.compilation, self.followers, self.condition = compilation, followers, condition
        self.onward: dict[Signal, tuple[list[tuple[Block, str]], list[Signal]]] = {}
        self.certain = {condition: Interval.point(0.0)}  # Intervals of signals while it is false

    def commands(self, start: Signal) -> Iterator[tuple[Block, str]]:
        """Yield (actuator, input) of each command that a held output determines, alone or with others."""
        waiting, seen = deque([start]), {start}
        while waiting:
            signal = waiting.popleft()
            if signal not in self.onward:
                self.onward[signal] = self.step(signal)
            commands, others = self.onward[signal]
            yield from commands
            waiting.extend(other for other in others if other not in seen)
            seen.update(others)

    def step(self, signal: Signal) -> tuple[list[tuple[Block, str]], list[Signal]]:
        """Return (commands that a signal is connected to, outputs of other blocks that it determines)."""
        readers = self.followers.get(signal, ())
        others = [
            Signal(block, output)
            for block, name in readers
            for output in block.outputs
            if not self.rests(block) and self.passes(block, name, output)
        ]
        return [(block, name) for block, name in readers if isinstance(block, Actuator)], others

    def rests(self, block: Block) -> bool:
        """Return whether a block passes nothing on while the condition is false."""
        return isinstance(block, Device) or self.condition in block.conditions

    def passes(self, block: Block, name: str, output: str) -> bool:
        """Return whether an input determines an output, alone or as a part of it: not as a condition or a position."""
        compilation = self.compilation
        sources = {source for each in block.inputs if isinstance(source := compilation.sources[block, each], Signal)}
        unit = block.inputs[name].unit
        start = compilation.sources[block, name]
        dtype = start.declaration.dtype if isinstance(start, Signal) else "float"
        part = unit == ANY and dtype == block.outputs[output].dtype == "float"
        if len(sources) > 1 and not part and compilation.units[block, output] != unit:
            return False
        inputs = {each: EVERYTHING if each == name else self.assumed(block, each) for each in block.inputs}
        made = self.made(block, output, inputs)
        return made is None or made.low != made.high

    def assumed(self, block: Block, name: str) -> Interval:
        """Return the Interval of another input: what is certain while the condition is false, or a typical number."""
        known = self.known(self.compilation.sources[block, name])
        return known if known.low == known.high or block.inputs[name].dtype != "float" else ONE

    def known(self, source: np.ndarray | Signal | None, depth: int = DEPTH) -> Interval:
        """Return the Interval of a source while the condition is false."""
        if not isinstance(source, Signal):
            return EVERYTHING if source is None else interval_of_numbers(source)
        block = source.block
        if source not in self.certain:
            self.certain[source] = EVERYTHING  # also within a loop
            if depth and not self.rests(block):
                inputs = {name: self.known(self.compilation.sources[block, name], depth - 1) for name in block.inputs}
                made = self.made(block, source.port, inputs)
                self.certain[source] = EVERYTHING if made is None else made
        return self.certain[source]

    @staticmethod
    def made(block: Block, output: str, inputs: dict[str, Interval]) -> Interval | None:
        """Return the Interval of an output for those of the inputs; None if the block states none."""
        try:
            stated: Interval | dict[str, Interval] | None = block.output_range(**inputs)
        except Exception:
            return None
        found = stated.get(output) if isinstance(stated, dict) else stated
        return found if found is not None else block.outputs[output].range


def late_parameters(compilation: Compilation, source: Signal) -> list[str]:
    """Return the live parameters behind a held signal that do not bound it while its block does not run."""
    bounds = held_bounds_of(source.block, source.block.held_within).get(source.port, ())
    at_once = {f"{source.block.path}.{name}" for side in bounds for name, _ in side.terms}
    found, waiting = {source.block}, [source.block]
    while waiting:
        block = waiting.pop()
        sources = (compilation.sources[block, name] for name in block.inputs)
        before = {each.block for each in sources if isinstance(each, Signal) and each.block.conditions}
        waiting += before - found
        found |= before
    names = (f"{block.path}.{name}" for block in found for name in block.parameters if block.live(name))
    return sorted(name for name in names if name not in at_once)
