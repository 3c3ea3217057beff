"""A diagram as a tree of subsystems, each with its blocks, its inner subsystems and the links between them.

A signal that enters or leaves a subsystem is split at a pin on its edge, so that each subsystem can be laid out
separately.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import TYPE_CHECKING, Any, TypeAlias, Union

from graph.block import Sink
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.diagram import Diagram

Key: TypeAlias = str | tuple[str, str]
"""A port, or a pin: ("in", "out" or "enabled", signal path)."""

End: TypeAlias = tuple[Union["Block", "Level", None], Key]
"""End of a link: (block, port), (Level, pin) or, for a pin of the level itself, (None, pin)."""


@dataclass(eq=False)
class Level:
    """A subsystem, or the diagram itself.

    things : blocks and Levels in the order of construction; pins : whether no target needs them within the tick
    """

    path: str
    title: str
    every: int = 1
    conditions: tuple[Signal, ...] = ()
    things: list[Block | Level] = field(default_factory=list["Block | Level"])
    levels: dict[str, Level] = field(default_factory=dict[str, "Level"])
    links: dict[tuple[End, End], Link] = field(default_factory=dict[tuple[End, End], "Link"])
    pins: dict[tuple[str, str], bool] = field(default_factory=dict[tuple[str, str], bool])
    laid: Any = field(init=False, repr=False)  # graph.drawing.compose.Laid

    def connect(self, source: End, target: End, signal: Signal, delayed: bool) -> None:
        """Add a link between two things of this level or of levels inside it; a link that exists is not doubled.

        source, target : (thing, its port); the thing is None for the border of this level
        delayed : whether the signal arrives one tick later
        """
        link = self.links.get((source, target))
        if link is None:
            self.links[source, target] = Link(source, target, signal, delayed)
        else:
            link.delayed = link.delayed and delayed
        for level, (thing, key) in ((self, source), (self, target)):
            level = level if thing is None else thing
            if isinstance(level, Level) and not isinstance(key, str):
                level.pins[key] = level.pins.get(key, True) and delayed


@dataclass(eq=False)
class Link:
    """A link between two ends in one level. delayed : whether the target does not need it within the tick"""

    source: End
    target: End
    signal: Signal
    delayed: bool


def outline(diagram: Diagram, taps: dict[Sink, list[tuple[str, Signal]]]) -> Level:
    """Return the Level of a diagram. taps : {sink: [(label, Signal)]} of sinks for any number of signals"""
    root = Level("", diagram.name)
    lineage: dict[Block, list[Level]] = {}  # the levels that contain a block, from the outermost
    for block in diagram:
        level, chain = root, [root]
        parts = block.path.split("/")
        for depth, part in enumerate(parts[:-1], 1):
            if part not in level.levels:
                level.levels[part] = Level("/".join(parts[:depth]), part)
                level.things.append(level.levels[part])
            level = level.levels[part]
            chain.append(level)
        level.things.append(block)
        lineage[block] = chain
    for chain in lineage.values():
        for level, inner in zip(chain, chain[1:]):
            find_rate_and_condition(inner, level, [b for b, c in lineage.items() if inner in c])
    for source, target, key, delayed in wires(diagram, taps):
        run(source, lineage[source.block], target, key, lineage[target], delayed)
    above = {chain[i]: chain[:i] for chain in lineage.values() for i in range(1, len(chain))}
    for level, chain in above.items():
        for signal in level.conditions[len(chain[-1].conditions) :]:
            run(signal, lineage[signal.block], level, ("enabled", signal.path), chain, False)
    for block, chain in lineage.items():
        for signal in block.conditions[len(chain[-1].conditions) :]:
            run(signal, lineage[signal.block], block, ("enabled", signal.path), chain, False)
    return root


def find_rate_and_condition(level: Level, outer: Level, blocks: Sequence[Block]) -> None:
    """Set the rate and the conditions that all blocks of a level share."""
    common = blocks[0].conditions
    for block in blocks:
        common = tuple(a for a, _ in takewhile(lambda pair: pair[0] == pair[1], zip(common, block.conditions)))
    rates = {block.every for block in blocks}
    level.conditions = common
    level.every = rates.pop() if len(rates) == 1 else outer.every


def wires(diagram: Diagram, taps: dict[Sink, list[tuple[str, Signal]]]) -> Iterator[tuple[Signal, Block, str, bool]]:
    """Yield (signal, target block, input, whether the target does not need it within the tick) of each wire."""
    for wire in diagram.wires:
        if wire.port is not None and isinstance(wire.source, Signal) and not wire.block.variadic:
            yield (
                wire.source,
                wire.block,
                wire.port,
                not isinstance(wire.block, Sink) and wire.port not in wire.block.step_inputs(),
            )
    for sink in taps:
        if sink.variadic:
            for label, signal in taps[sink]:
                yield signal, sink, label, False


def run(
    signal: Signal,
    source_chain: Sequence[Level],
    target: Block | Level,
    key: Key,
    target_chain: Sequence[Level],
    delayed: bool,
) -> None:
    """Connect a signal to a port or pin of `target`, through the pins of all levels between them."""
    shared = sum(a is b for a, b in zip(source_chain, target_chain))
    end: End = signal.block, signal.port
    for level in reversed(source_chain[shared:]):
        level.connect(end, (None, ("out", signal.path)), signal, delayed)
        end = level, ("out", signal.path)
    at = source_chain[shared - 1]
    for level in target_chain[shared:]:
        at.connect(end, (level, ("in", signal.path)), signal, delayed)
        end = None, ("in", signal.path)
        at = level
    at.connect(end, (target, key), signal, delayed)
