"""Drawings of diagrams as data, converted to SVG, an HTML page, or Mermaid text.

drawing = draw(diagram)
svg(drawing)                    '<svg ...'
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from graph.compiler import examine
from graph.diagram import Diagram
from graph.drawing.cards import block_card, signal_text
from graph.drawing.mermaid import mermaid
from graph.drawing.model import Drawing
from graph.drawing.outline import outline, selections
from graph.drawing.page import page
from graph.drawing.style import MARGIN
from graph.drawing.svg import svg
from graph.drawing.twins import find_twins
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.compilation import Compilation

__all__ = ["Drawing", "draw", "mermaid", "page", "svg"]


def draw(
    diagram: Diagram,
    *,
    all_ports: bool = False,
    values: bool = False,
    fold: bool = False,
    place: Callable[[Any], str] = str,
) -> Drawing:
    """Lay out the Drawing of a diagram, which may have errors.

    all_ports : include the ports that are not wired
    values : leave room for a value beside each output
    fold : draw a subsystem that is like an earlier one, such as the other leg, as one box
    place : converts the Location of a block to text
    """
    from graph.drawing.compose import Picture, collect, lay_out  # imports networkx: 20 MB and 0.1 s

    found = examine(diagram)
    root = outline(diagram, found.taps)
    find_twins(root, diagram)
    laid = lay_out(root, found, all_ports, values, fold)
    picture = Picture()
    collect(root, MARGIN, MARGIN, found, picture)
    targets = wired_to(diagram, found)
    return Drawing(
        diagram.name,
        diagram.rate,
        laid.width + 2 * MARGIN,
        laid.height + 2 * MARGIN,
        tuple(picture.boxes),
        tuple(picture.frames),
        tuple(picture.lines),
        cards={block.path: block_card(block, found, targets, place) for block in diagram},
        signals={
            f"{block.path}.{name}": signal_text(Signal(block, name), found)
            for block in diagram
            for name in block.outputs
        },
        elements={block.path: source.path for block, (source, _, _) in selections(diagram).items()},
    )


def wired_to(diagram: Diagram, found: Compilation) -> dict[str, list[str]]:
    """Return {signal path: [paths of the ports it is wired to]}."""
    targets: dict[str, list[str]] = {}
    for wire in diagram.wires:
        if isinstance(wire.source, Signal) and not wire.block.variadic:
            targets.setdefault(wire.source.path, []).append(f"{wire.block.path}.{wire.port}")
    for sink, taps in found.taps.items():
        for label, signal in taps if sink.variadic else ():
            targets.setdefault(signal.path, []).append(f"{sink.path}.{label}")
    return targets
