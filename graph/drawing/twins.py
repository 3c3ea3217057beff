"""Subsystems with the same blocks, wires and constants, such as the two legs of a robot: one shows both."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from graph.drawing import cards
from graph.drawing.splitting import Part
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.diagram import Diagram
    from graph.drawing.outline import Key, Level

LIKENESS_LIMIT = 3  # blocks, from which a subsystem can be drawn as "like the other"
DIFFERENCE_LIMIT = 8  # blocks with parameters that differ


def find_twins(outer: Level, diagram: Diagram) -> None:
    """Set `like` and `but` of every level inside that has the blocks, wires and constants of an earlier sibling."""
    constants = {
        (wire.block, wire.port): cards.quantity(wire.source, "1")
        for wire in diagram.wires
        if not isinstance(wire.source, Signal)
    }
    for level in outer.levels.values():
        find_twins(level, diagram)
    known: list[tuple[int, Level, Any]] = []
    for (_, share), level in outer.levels.items():
        shape = shape_of(level, level.prefix, constants)
        twin = next((other for n, other, known_shape in known if n == share and known_shape == shape), None)
        but = differences(level, twin) if twin else []
        if twin and len(list(parts_in(level))) >= LIKENESS_LIMIT and len(but) <= DIFFERENCE_LIMIT:
            level.like, level.but = twin, but
        else:
            known.append((share, level, shape))


def parts_in(level: Level) -> Iterator[Part]:
    """Yield the parts of a level and of all levels inside."""
    for thing in level.things:
        if not isinstance(thing, Part):
            yield from parts_in(thing)
        else:
            yield thing


def shape_of(level: Level, prefix: str, constants: dict[tuple[Block, str | None], str]) -> Any:
    """Return what is equal for two levels with the same blocks, wires and constants. prefix : path of the outermost"""

    def name(thing: Part | Level | None, key: Key) -> tuple[str, str]:
        place = "" if thing is None else thing.path[len(prefix) :]
        if isinstance(key, str):
            return place, key
        side, path = key
        return place, side + (path[len(prefix) :] if path.startswith(prefix + "/") else "")

    blocks = [
        (
            part.path[len(prefix) :],
            type(part.block),
            part.block.every,
            [constants.get((part.block, port)) for port in part.block.inputs],
        )
        for part in level.things
        if isinstance(part, Part)
    ]
    links = sorted(name(*link.source) + name(*link.target) for link in level.links.values())
    return blocks, links, [shape_of(inner, prefix, constants) for inner in level.levels.values()]


def differences(level: Level, twin: Level) -> list[str]:
    """Return a line for each block whose parameters differ from those of a twin, beyond the name of the subsystem."""
    lines: list[str] = []
    for part, other in zip(parts_in(level), parts_in(twin)):
        if part.half == "command":
            continue
        pairs = zip(cards.parameter_cards(part.block), cards.parameter_cards(other.block))
        words = [
            f"{card['name']} {card['value']}"
            for card, its in pairs
            if card["value"] != its["value"].replace(twin.title, level.title)
        ]
        if words:
            lines.append(f"{part.block.path[len(level.prefix) + 1 :]}: {', '.join(words)}")
    return lines
