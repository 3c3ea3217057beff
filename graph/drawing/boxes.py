"""Text and size of the box of a block."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from graph.drawing import cards
from graph.drawing.chart import Chart, chart_of
from graph.drawing.style import HEAD, LINE, PADDING, ROW, SMALL, TEXT, TITLE, fit, text_width
from graph.names import snake_case
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block
    from graph.compilation import Compilation
    from graph.drawing.outline import Key, Level, Link
    from graph.drawing.splitting import Part

BOX_WIDTH_LIMIT = 260.0  # px
DETAIL_LIMIT = 4  # lines of parameters on a box


@dataclass(eq=False)
class Plan:
    """Box of a block, or of a subsystem that is like another, without a position.

    path : of the box; family : key of style.FAMILIES, or "subsystem"
    left, right : {port: y from the top} in px; labels, notes : {port: text beside it}
    signals : {element of an output: path of the signal}
    """

    path: str
    family: str
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
    signals: dict[Key, str] = field(default_factory=dict["Key", str])
    chart: Chart | None = None


def plan(part: Part, found: Compilation, all_ports: bool, values: bool, links: Collection[Link], every: int) -> Plan:
    """Return the Plan of a block or of half an actuator.

    found : graph.compilation.Compilation
    all_ports : include ports without a wire
    values : leave room for a value beside each output
    links : the Links of its level
    every : rate divisor of its level
    """
    block = part.block
    errors = [d for d in found.errors if d.path == block.path]
    if part.half:
        errors = [d for d in errors if (d.port in block.inputs) == (part.half == "command")]
    wrong_ports: frozenset[Key] = frozenset(d.port for d in errors if d.port)
    inputs = {link.target[1]: None for link in links if link.target[0] is part}
    outputs = {link.source[1] for link in links if link.source[0] is part}
    constants: dict[Key, Any] = {
        wire.port or "": wire.source
        for wire in found.diagram.wires
        if wire.block is block and not isinstance(wire.source, Signal)
    }
    shown = inputs.keys() | constants.keys() | wrong_ports
    left: list[Key] = [name for name in block.inputs if (all_ports or name in shown) and part.half != "feedback"]
    left += [name for name in inputs if name not in block.inputs]
    right: list[Key] = [name for name in block.outputs if (all_ports or name in outputs) and part.half != "command"]
    right += part.elements
    labels = {name: name if isinstance(name, str) else "enabled" for name in left + right}
    notes: dict[Key, str] = {
        name: f"= {cards.quantity(value, '1') if not hasattr(value, '__len__') else 'array'}"
        for name, value in constants.items()
    }
    if values:
        notes |= {name: value_room(block, found, name) for name in block.outputs if name in right}
        notes |= {key: value_room(signal.block, found, signal.port) for key, signal in part.elements.items()}
    else:
        notes |= {key: own_name(signal.block) for key, signal in part.elements.items()}

    kind = type(block).__name__
    name = block.path.rpartition("/")[2]
    named = name != snake_case(kind)
    details = [f"every {block.every} ticks"] if block.every != every else []
    chart = chart_of(block)
    drawn = ("takes", "gives", "holds", "states", "transitions") if chart else ()
    if part.half == "command":
        details, named, kind = [], True, f"{kind}, command"
    else:
        details += [
            f"{card['name']} {card['value']}"
            for card in cards.parameter_cards(block)
            if card["own"] and card["name"] not in drawn
        ]
    if block.variadic and not inputs:
        details.insert(0, "takes every port")
    if len(details) > DETAIL_LIMIT:
        details = details[: DETAIL_LIMIT - 1] + [f"and {len(details) - DETAIL_LIMIT + 1} more"]

    title, subtitle = (name, kind) if named else (kind, "")
    messages = tuple(dict.fromkeys(d.title + ": " + d.message for d in errors))
    family = cards.family(type(block))
    box = sized(part.path, family, title, subtitle, details, left, right, labels, notes, messages, wrong_ports, chart)
    box.signals |= {key: signal.path for key, signal in part.elements.items()}
    return box


def twin(level: Level) -> Plan:
    """Return the Plan of a subsystem that is like another: its pins, and the parameters that differ."""
    assert level.like is not None
    left: list[Key] = [key for key in level.pins if key[0] != "out"]
    right: list[Key] = [key for key in level.pins if key[0] == "out"]
    labels: dict[Key, str] = {key: key[1].removeprefix(level.prefix + "/") for key in level.pins}
    share = f", {level.share}" if level.share else ""
    subtitle = f"as {level.like.title}{share}" + ", but for" * bool(level.but)
    return sized(level.path, "subsystem", level.title, subtitle, level.but, left, right, labels, {}, (), frozenset())


def sized(
    path: str,
    family: str,
    title: str,
    subtitle: str,
    details: Sequence[str],
    left: Sequence[Key],
    right: Sequence[Key],
    labels: dict[Key, str],
    notes: dict[Key, str],
    messages: tuple[str, ...],
    wrong_ports: frozenset[Key],
    chart: Chart | None = None,
) -> Plan:
    """Return the Plan with the size and the ports that its text requires."""
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
    inside = chart.width + 2 * PADDING if chart else 0.0
    width = math.ceil(max(inside, min(width, max(BOX_WIDTH_LIMIT, sum(sides) + PADDING))))
    head = HEAD + (LINE - 2.0 if subtitle else 0.0)
    rows = max(len(left), len(right))
    height = head + ROW * rows + (LINE * len(details) + 7.0 if details else 0.0) + (4.0 if rows else 0.0)
    height += chart.height + 4.0 if chart else 0.0
    room = width - 2 * PADDING

    def heights(names: Sequence[Key]) -> dict[Key, float]:
        return {n: round(head + ROW * (index + 0.5) + 2.0) for index, n in enumerate(names)}

    return Plan(
        path,
        family,
        fit(title, TITLE, room, bold=True),
        fit(subtitle, SMALL, room),
        tuple(fit(text, SMALL, room) for text in details),
        heights(left),
        heights(right),
        labels,
        notes,
        messages,
        wrong_ports,
        width,
        round(height),
        chart=chart,
    )


def own_name(block: Block) -> str:
    """Return the name of a block if it is not the one of its type."""
    name, default = block.path.rpartition("/")[2], snake_case(type(block).__name__)
    return "" if re.fullmatch(default + r"(_\d+)?", name) else name


def value_room(block: Block, found: Compilation, name: str) -> str:
    """Return a text as wide as a value of an output, "" for more than three elements."""
    elements = math.prod(found.shapes[block, name])
    if elements > 1:
        return " ".join(["−00.0"] * elements) if elements <= 3 else ""
    return "yes" if block.outputs[name].dtype == "bool" else cards.quantity(-888.8, found.units[block, name])
