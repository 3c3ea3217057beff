"""Text and size of the box of a block."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from graph.drawing import cards
from graph.drawing.style import HEAD, LINE, PADDING, ROW, SMALL, TEXT, TITLE, fit, text_width
from graph.names import snake_case
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.compilation import Compilation
    from graph.drawing.outline import Key, Link

BOX_WIDTH_LIMIT = 260.0  # px
DETAIL_LIMIT = 4  # lines of parameters on a box


@dataclass(eq=False)
class Plan:
    """Box of a block without a position.

    left, right : {port: y from the top} in px; labels, notes : {port: text beside it}
    """

    block: Block
    title: str
    subtitle: str
    details: tuple[str, ...]
    left: dict[Key, float]
    right: dict[Key, float]
    labels: dict[Key, str]
    notes: dict[Key, str]
    wrong: tuple[str, ...]
    wrong_ports: frozenset[Key]
    width: float
    height: float


def plan(block: Block, found: Compilation, all_ports: bool, values: bool, links: Collection[Link], every: int) -> Plan:
    """Return the Plan of a block.

    found : graph.compilation.Compilation
    all_ports : include ports without a wire
    values : leave room for a value beside each output
    links : the Links of its level
    every : rate divisor of its level
    """
    errors = [d for d in found.errors if d.path == block.path]
    wrong_ports: frozenset[Key] = frozenset(d.port for d in errors if d.port)
    inputs = {link.target[1]: None for link in links if link.target[0] is block}
    outputs = {link.source[1]: None for link in links if link.source[0] is block}
    constants: dict[Key, Any] = {
        wire.port or "": wire.source
        for wire in found.diagram.wires
        if wire.block is block and not isinstance(wire.source, Signal)
    }
    shown = inputs.keys() | constants.keys() | wrong_ports
    left: list[Key] = [name for name in block.inputs if all_ports or name in shown]
    left += [name for name in inputs if name not in block.inputs]
    right: list[Key] = [name for name in block.outputs if all_ports or name in outputs]
    labels = {name: name if isinstance(name, str) else "enabled" for name in left + right}
    notes: dict[Key, str] = {
        name: f"= {cards.quantity(value, '1') if not hasattr(value, '__len__') else 'array'}"
        for name, value in constants.items()
    }
    if values:
        notes |= {name: value_room(block, found, name) for name in block.outputs if name in right}

    kind = type(block).__name__
    name = block.path.rpartition("/")[2]
    named = name != snake_case(kind)
    details = [f"every {block.every} ticks"] if block.every != every else []
    details += [f"{card['name']} {card['value']}" for card in cards.parameter_cards(block) if card["own"]]
    if block.variadic and not inputs:
        details.insert(0, "takes every port")
    if len(details) > DETAIL_LIMIT:
        details = details[: DETAIL_LIMIT - 1] + [f"and {len(details) - DETAIL_LIMIT + 1} more"]

    title, subtitle = (name, kind) if named else (kind, "")
    sides = [
        max((text_width(labels[n] + notes.get(n, ""), TEXT) + PADDING * 1.4 for n in names), default=0.0)
        for names in (left, right)
    ]
    width = max(
        text_width(title, TITLE, bold=True) + 2 * PADDING,
        text_width(subtitle, SMALL) + 2 * PADDING,
        sum(sides) + PADDING,
        *(text_width(text, SMALL) + 2 * PADDING for text in details),
        92.0,
    )
    width = math.ceil(min(width, max(BOX_WIDTH_LIMIT, sum(sides) + PADDING)))
    head = HEAD + (LINE - 2.0 if subtitle else 0.0)
    rows = max(len(left), len(right))
    height = head + ROW * rows + (LINE * len(details) + 7.0 if details else 0.0) + (4.0 if rows else 0.0)
    room = width - 2 * PADDING

    def heights(names: Sequence[Key]) -> dict[Key, float]:
        return {n: round(head + ROW * (index + 0.5) + 2.0) for index, n in enumerate(names)}

    return Plan(
        block,
        fit(title, TITLE, room, bold=True),
        fit(subtitle, SMALL, room),
        tuple(fit(text, SMALL, room) for text in details),
        heights(left),
        heights(right),
        labels,
        notes,
        tuple(dict.fromkeys(d.title + ": " + d.message for d in errors)),
        wrong_ports,
        width,
        round(height),
    )


def value_room(block: Block, found: Compilation, name: str) -> str:
    """Return a text as wide as a value of an output, "" for more than three elements."""
    elements = math.prod(found.shapes[block, name])
    if elements > 1:
        return " ".join(["−00.0"] * elements) if elements <= 3 else ""
    return "yes" if block.outputs[name].dtype == "bool" else cards.quantity(-888.8, found.units[block, name])
