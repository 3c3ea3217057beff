"""Drawings of diagrams: first data, where everything lies, then SVG, a page, or Mermaid text.

    drawing = draw(diagram)
    svg(drawing)                    '<svg ...'
"""

from graph.compiler import examine
from graph.drawing.compose import collect, lay_out
from graph.drawing.model import Drawing
from graph.drawing.outline import outline
from graph.drawing.style import MARGIN
from graph.drawing.svg import svg

__all__ = ["Drawing", "draw", "svg"]


def draw(diagram, *, all_ports=False):
    """The Drawing of a diagram, of one with mistakes too. all_ports : with the ports that nothing is wired to."""
    found = examine(diagram)
    root = outline(diagram, found.taps)
    laid = lay_out(root, found, all_ports)
    picture = {"boxes": [], "frames": [], "lines": []}
    collect(root, MARGIN, MARGIN, found, picture)
    return Drawing(
        diagram.name, diagram.rate, laid.width + 2 * MARGIN, laid.height + 2 * MARGIN, **{key: tuple(things) for key, things in picture.items()})
