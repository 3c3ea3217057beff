"""A diagram as a tree of subsystems, each with its blocks, its inner subsystems and the links between them.

A signal that enters or leaves a subsystem is split at a pin on its edge, so that each subsystem can be laid out
separately. Elements of a signal are further outputs of its block: `euler[1]`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import TYPE_CHECKING, Any, TypeAlias, Union

from graph.arithmetic import Select
from graph.block import Sink
from graph.device import Actuator
from graph.drawing.splitting import Part, loops, split
from graph.narrowing import is_row, is_table
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.diagram import Diagram

Key: TypeAlias = str | tuple[str, str]
"""A port, or a pin: ("in", "out" or "enabled", path of an output or of its elements)."""

End: TypeAlias = tuple[Union[Part, "Level", None], Key]
"""End of a link: (part, port), (Level, pin) or, for a pin of the level itself, (None, pin)."""

Source: TypeAlias = "tuple[Block, str, Signal]"
"""(block, output or elements of it, signal)"""


@dataclass(eq=False)
class Level:
    """A subsystem or a part of it, or the diagram itself.

    path : "left", or "left=2" of its second part; prefix : path of the subsystem; share : "2 of 2" of a part
    things : parts of blocks and Levels in the order of construction
    pins : whether no target needs them within the tick
    like : the Level that has the same blocks and wires, if there is one before it; but : parameters that differ
    """

    path: str
    title: str
    prefix: str = ""
    share: str = ""
    every: int = 1
    conditions: tuple[Signal, ...] = ()
    things: list[Part | Level] = field(default_factory=list["Part | Level"])
    levels: dict[tuple[str, int], Level] = field(default_factory=dict[tuple[str, int], "Level"])
    links: dict[tuple[End, End], Link] = field(default_factory=dict[tuple[End, End], "Link"])
    pins: dict[tuple[str, str], bool] = field(default_factory=dict[tuple[str, str], bool])
    like: Level | None = None
    but: list[str] = field(default_factory=list[str])
    laid: Any = field(init=False, repr=False)  # graph.drawing.compose.Laid

    def connect(self, source: End, target: End, signal: Signal, delayed: bool, loop: bool) -> None:
        """Add a link between two things of this level or of levels inside it; a link that exists is not doubled.

        source, target : (thing, its port); the thing is None for the border of this level
        delayed : whether the signal arrives one tick later
        loop : whether the signal returns to its block
        """
        link = self.links.get((source, target))
        if link is None:
            self.links[source, target] = Link(source, target, signal, delayed, loop)
        else:
            link.delayed = link.delayed and delayed
            link.loop = link.loop or loop
        for level, (thing, key) in ((self, source), (self, target)):
            level = level if thing is None else thing
            if isinstance(level, Level) and not isinstance(key, str):
                level.pins[key] = level.pins.get(key, True) and delayed


@dataclass(eq=False)
class Link:
    """A link between two ends in one level.

    delayed : whether the target does not need it within the tick; loop : whether it is in a loop of blocks
    """

    source: End
    target: End
    signal: Signal
    delayed: bool
    loop: bool


def outline(diagram: Diagram, taps: dict[Sink, list[tuple[str, Signal]]]) -> Level:
    """Return the Level of a diagram. taps : {sink: [(label, Signal)]} of sinks for any number of signals"""
    elements = selections(diagram)
    links = [
        (source_of(signal, elements), block, key, delayed)
        for signal, block, key, delayed in wires(diagram, taps)
        if block not in elements
    ]
    ends = parts_of((block for block in diagram if block not in elements), links)
    edges = [(ends[source[0]][1], ends[block][0]) for source, block, _, _ in links]
    for block in ends:
        sources = [source_of(signal, elements)[0] for signal in block.conditions]
        edges += [(ends[source][1], part) for source in sources for part in ends[block]]
    split(list(dict.fromkeys(part for pair in ends.values() for part in reversed(pair))), edges)
    number = loops(edges)
    for block, key, signal in elements.values():
        ends[block][1].elements[key] = signal
    for block, (command, feedback) in ends.items():
        if not command.half:  # in one place
            ends[block] = feedback, feedback

    root = Level("", diagram.name)
    lineage: dict[Part, list[Level]] = {}  # the levels that contain a part, from the outermost
    for part in dict.fromkeys(part for pair in ends.values() for part in reversed(pair)):
        chain = lineage[part] = [root]
        for name, share in part.chain:
            level = chain[-1]
            if (name, share) not in level.levels:
                path, prefix = (f"{at}/{name}".lstrip("/") for at in (level.path, level.prefix))
                level.levels[name, share] = Level(path + f"={share}" * (share > 1), name, prefix)
                level.things.append(level.levels[name, share])
            chain.append(level.levels[name, share])
        chain[-1].things.append(part)
    for chain in lineage.values():
        for level, inner in zip(chain, chain[1:]):
            find_rate_and_condition(inner, level, [part.block for part, c in lineage.items() if inner in c])

    def connect(source: Source, target: Part | Level, key: Key, chain: Sequence[Level], delayed: bool) -> None:
        part = ends[source[0]][1]
        loop = isinstance(target, Part) and number.get(part, -1) == number.get(ends[target.block][0], -2)
        run(part, source, lineage[part], target, key, chain, delayed, loop)

    for source, block, key, delayed in links:
        connect(source, ends[block][0], key, lineage[ends[block][0]], delayed)
    above = {chain[i]: chain[:i] for chain in lineage.values() for i in range(1, len(chain))}
    for thing, chain in [*above.items(), *lineage.items()]:
        conditions = thing.conditions if isinstance(thing, Level) else thing.block.conditions
        for signal in conditions[len(chain[-1].conditions) :]:
            connect(source_of(signal, elements), thing, ("enabled", signal.path), chain, False)
    for level in [*above, root]:
        shares = Counter(name for name, _ in level.levels)
        for (name, share), inner in level.levels.items():
            inner.share = f"{share} of {shares[name]}" if share else ""
    return root


def selections(diagram: Diagram) -> dict[Block, Source]:
    """Return {Select block: its elements as an output of their source}, of those that are always computed with it."""
    inputs = {wire.block: wire.source for wire in diagram.wires if isinstance(wire.block, Select)}
    found: dict[Block, Source] = {}
    first: dict[tuple[Block, str], Source] = {}
    for block, signal in inputs.items():
        if isinstance(signal, Signal) and (block.every, block.conditions) == (
            signal.block.every,
            signal.block.conditions,
        ):
            source, key, _ = source_of(signal, found)
            key += f"[{index_text(block)}]"
            found[block] = first.setdefault((source, key), (source, key, Signal(block, "y")))
    return found


def source_of(signal: Signal, elements: dict[Block, Source]) -> Source:
    """Return where a signal is drawn to come from. elements : of `selections`"""
    return elements.get(signal.block) or (signal.block, signal.port, signal)


def index_text(block: Select) -> str:
    """Return the index of a Select block as Python source."""

    def text(index: Any) -> str:
        if not is_table(index):
            return str(index)
        if "slice" in index:
            start, stop, step = ("" if end is None else str(end) for end in index["slice"])
            return f"{start}:{stop}" + f":{step}" * bool(step)
        return "..." if "ellipsis" in index else str(list(index["list"]))

    index: Any = block.index
    if is_row(index):
        return ", ".join(map(text, index)) if block.of is not None else str(list(index))
    return text(index)


def parts_of(
    blocks: Iterable[Block], links: Sequence[tuple[Source, Block, str, bool]]
) -> dict[Block, tuple[Part, Part]]:
    """Return {block: (part with its inputs, part with its outputs)}, two of an actuator with both."""
    both = {source[0] for source, *_ in links} & {link[1] for link in links}
    found: dict[Block, tuple[Part, Part]] = {}
    for block in blocks:
        halves = isinstance(block, Actuator) and block in both
        feedback = Part(block, "feedback" if halves else "")
        found[block] = (Part(block, "command") if halves else feedback), feedback
    return found


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
    part: Part,
    source: Source,
    source_chain: Sequence[Level],
    target: Part | Level,
    key: Key,
    target_chain: Sequence[Level],
    delayed: bool,
    loop: bool,
) -> None:
    """Connect a signal to a port or pin of `target`, through the pins of all levels between them."""
    shared = sum(a is b for a, b in zip(source_chain, target_chain))
    end: End = part, source[1]
    name, signal = f"{source[0].path}.{source[1]}", source[2]
    for level in reversed(source_chain[shared:]):
        level.connect(end, (None, ("out", name)), signal, delayed, loop)
        end = level, ("out", name)
    at = source_chain[shared - 1]
    for level in target_chain[shared:]:
        at.connect(end, (level, ("in", name)), signal, delayed, loop)
        end = None, ("in", name)
        at = level
    at.connect(end, (target, key), signal, delayed, loop)
