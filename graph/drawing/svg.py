"""SVG of a drawing, in one file without scripts, for papers and for the HTML page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

from graph.drawing.chart import INDENT
from graph.drawing.style import (
    BACK,
    CORNER,
    FAINT,
    FAMILIES,
    FONT,
    FRAME_EDGE,
    FRAME_FILL,
    FRAME_HEAD,
    FRAME_TITLE,
    HEAD,
    INK,
    LINE,
    MARGIN,
    PADDING,
    PAPER,
    SMALL,
    TEXT,
    TITLE,
    WIRE,
    WRONG,
    text_width,
)

if TYPE_CHECKING:
    from graph.drawing.chart import Chart
    from graph.drawing.model import Box, Drawing, Frame, Line, Point

LEGEND, FEEDBACK = 28.0, "feedback"


def css() -> str:
    """Return the style sheet of the drawings."""
    rules = [
        f"text {{ font-family: {FONT}; fill: {INK}; }}",
        f".title {{ font-size: {TITLE:g}px; font-weight: 600; }} .type {{ font-size: {SMALL:g}px; fill: {FAINT}; }}",
        f".port {{ font-size: {TEXT:g}px; }} .detail, .note {{ font-size: {SMALL:g}px; fill: {FAINT}; }} .end {{ "
        "text-anchor: end; }",
        f".paper {{ fill: {PAPER}; }} .frame > .edge, .frame > .head {{ stroke: {FRAME_EDGE}; }}",
        f".frame > .edge {{ fill: {FRAME_FILL}; }} .frame > .head {{ fill: {FRAME_HEAD}; }}",
        f".box > .body {{ fill: {PAPER}; }} .box > .edge {{ fill: none; stroke-width: 1.2; }} .dot, .joint {{ fill: "
        f"{WIRE}; }}",
        f".line {{ fill: none; stroke: {WIRE}; stroke-width: 1.4; stroke-linecap: round; }} .wide {{ stroke-width: "
        "2.8; }",
        f".back {{ stroke: {BACK}; stroke-dasharray: 7 4; stroke-linecap: butt; }} .joint.back {{ fill: {BACK}; }}",
    ]
    rules += [
        f".{name} > .edge {{ stroke: {family.edge}; }} .{name} > .head {{ fill: {family.head}; }}"
        for name, family in FAMILIES.items()
    ]
    logic = FAMILIES["logic"]
    rules.append(
        f".state > rect {{ fill: {PAPER}; stroke: {logic.edge}; }} .state.active > rect {{ fill: {logic.head}; }}"
    )
    rules.append(f".arrow {{ fill: none; stroke: {logic.edge}; }}")
    rules.append(f".subsystem > .edge {{ stroke: {FRAME_EDGE}; }} .subsystem > .head {{ fill: {FRAME_HEAD}; }}")
    rules.append(f".wrong > .edge, .line.wrong {{ stroke: {WRONG}; }} .wrong > .edge {{ stroke-width: 2.6; }}")
    rules.append(f".dot.wrong {{ fill: {WRONG}; r: 4px; }}")
    return "\n".join(rules)


def svg(drawing: Drawing) -> str:
    """Return the SVG text of a drawing, with a legend below it."""
    key = "".join(legend(drawing))
    width, height = number(max(drawing.width, legend_width(drawing))), number(drawing.height + LEGEND)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
            'role="img">',
            f"<title>{escape(drawing.name)}</title>",
            f"<style>\n{css()}\n</style>",
            f'<rect class="paper" width="{width}" height="{height}"/>',
            *body(drawing),
            key,
            "</svg>",
            "",
        ]
    )


def legend(drawing: Drawing) -> Iterator[str]:
    """Yield the SVG of the legend: name and rate of the diagram, colours, and feedback lines."""
    x, y = MARGIN, drawing.height
    yield f'<g class="legend"><text class="title" x="{number(x)}" y="{number(y + 4)}">{escape(heading(drawing))}</text>'
    x += text_width(heading(drawing), TITLE, bold=True) + 2 * MARGIN
    for name in used(drawing):
        yield (
            f'<g class="box {name}" transform="translate({number(x)} {number(y - 6)})"><rect class="body" '
            'width="16" height="12" rx="3"/>'
        )
        yield (
            '<path class="head" d="M.6 11.4V3Q.6 .6 3 .6H13Q15.4 .6 15.4 3V11.4Z"/><rect class="edge" width="16" '
            'height="12" rx="3"/></g>'
        )
        yield f'<text class="type" x="{number(x + 22)}" y="{number(y + 3.6)}">{FAMILIES[name].title}</text>'
        x += legend_item(FAMILIES[name].title)
    if any(line.loop for line in drawing.lines):
        yield f'<path class="line back" d="M{number(x)} {number(y)}h28"/>'
        yield f'<text class="type" x="{number(x + 34)}" y="{number(y + 3.6)}">{FEEDBACK}</text>'
    yield "</g>"


def heading(drawing: Drawing) -> str:
    """Return the title of a drawing: name and rate."""
    return f"{drawing.name}, {drawing.rate:g} Hz"


def used(drawing: Drawing) -> list[str]:
    """Return the families of the blocks in a drawing, in the order of FAMILIES."""
    return [name for name in FAMILIES if any(item.family == name for item in drawing.boxes)]


def legend_item(text: str) -> float:
    """Return the width of an entry of the legend."""
    return 22.0 + text_width(text, SMALL) + 18.0


def legend_width(drawing: Drawing) -> int:
    """Return the width of title and legend."""
    items = sum(legend_item(FAMILIES[name].title) for name in used(drawing)) + legend_item(FEEDBACK) + 12.0
    return math.ceil(3 * MARGIN + text_width(heading(drawing), TITLE, bold=True) + items + MARGIN)


def body(drawing: Drawing) -> Iterator[str]:
    """Yield the SVG of frames, lines and boxes, from back to front."""
    yield from (frame(item) for item in drawing.frames)
    for lines in nets(drawing):
        yield from (line(item, start, drawing) for item, start in zip(lines, branches(lines)))
        yield joints(lines)
    yield from (box(item, drawing) for item in drawing.boxes)


def frame(item: Frame) -> str:
    """Return the SVG of a subsystem. Its parts have absolute positions, so that a page can move them separately."""
    left, top, right, bottom = (number(v) for v in (item.x, item.y, item.x + item.width, item.y + item.height))
    inner_left, inner_right, inner_top, inner_bottom, under = (
        number(v)
        for v in (item.x + 10, item.x + item.width - 10, item.y + 10, item.y + item.height - 10, item.y + FRAME_TITLE)
    )
    upper = f"V{inner_top}Q{left} {top} {inner_left} {top}H{inner_right}Q{right} {top} {right} {inner_top}"
    lower = (
        f"V{inner_bottom}Q{right} {bottom} {inner_right} {bottom}H{inner_left}Q{left} {bottom} {left} {inner_bottom}"
    )
    parts = [
        f'<g class="frame" data-path="{escape(item.path)}">',
        f'<path class="edge" d="M{left} {inner_bottom}{upper}{lower}Z"/>',
        f'<path class="head" d="M{left} {under}{upper}V{under}Z"/>',
        f'<text class="title" x="{number(item.x + 12)}" y="{number(item.y + 18)}">{escape(item.title)}</text>',
    ]
    if item.note:
        parts.append(
            f'<text class="note end" x="{number(item.x + item.width - 12)}" '
            f'y="{number(item.y + 17)}">{escape(item.note)}</text>'
        )
    return "".join(parts) + "</g>"


def nets(drawing: Drawing) -> Iterable[list[Line]]:
    """Return the lines of a drawing grouped by signal, frame and direction, feedback last."""
    groups: dict[tuple[str, str, bool], list[Line]] = {}
    for item in sorted(drawing.lines, key=lambda item: item.back):
        groups.setdefault((item.signal, item.subsystem, item.back), []).append(item)
    return groups.values()


def line(item: Line, start: float, drawing: Drawing) -> str:
    """Return the SVG of a line from `start` px on; the part before is shared with a line already drawn."""
    names = "line" + " back" * item.loop + " wide" * item.wide + " wrong" * item.wrong
    data = f'data-signal="{escape(item.signal)}" data-in="{escape(item.subsystem)}"'
    text = escape(drawing.signals.get(item.signal, item.signal))
    return f'<path class="{names}" {data} d="{way(rest(item.points, start), item.joints)}"><title>{text}</title></path>'


def joints(lines: Sequence[Line]) -> str:
    """Return the SVG of the joints where lines of one signal branch."""
    names = "joint" + " back" * lines[0].loop
    data = f'data-signal="{escape(lines[0].signal)}" data-in="{escape(lines[0].subsystem)}"'
    places = sorted({joint for item in lines for joint in item.joints})
    return "".join(f'<circle class="{names}" {data} cx="{number(x)}" cy="{number(y)}" r="2.6"/>' for x, y in places)


def branches(lines: Sequence[Line]) -> list[float]:
    """Return the length in px that each line from one port shares with an earlier one."""
    return [
        max((common_length(item.points, other.points) for other in lines[:index]), default=0.0)
        for index, item in enumerate(lines)
    ]


def common_length(one: Sequence[Point], other: Sequence[Point]) -> float:
    """Return the length of the common beginning of two paths."""
    length = 0.0
    for (a, b), (c, d) in zip(pairwise(one), pairwise(other)):
        (dx, dy), (ex, ey) = (b[0] - a[0], b[1] - a[1]), (d[0] - c[0], d[1] - c[1])
        if dx * ey - dy * ex or dx * ex + dy * ey <= 0:
            break
        length += min(abs(dx) + abs(dy), abs(ex) + abs(ey))
        if b != d:
            break
    return length


def rest(points: Sequence[Point], start: float) -> Sequence[Point]:
    """Return the points of a path without its first `start` px."""
    for index, (a, b) in enumerate(pairwise(points)):
        length = abs(b[0] - a[0]) + abs(b[1] - a[1])
        if start < length:
            return [
                (a[0] + (b[0] - a[0]) * start / length, a[1] + (b[1] - a[1]) * start / length),
                *points[index + 1 :],
            ]
        start -= length
    return points[-2:]


def way(points: Sequence[Point], joints: Sequence[Point] = ()) -> str:
    """Return the `d` attribute of a path, with rounded corners except at joints."""
    text = f"M{number(points[0][0])} {number(points[0][1])}"
    for before, point, after in zip(points, points[1:], points[2:]):
        (x1, y1), r1 = toward(point, before)
        (x2, y2), r2 = toward(point, after)
        if point in joints or min(r1, r2) < 1.0:
            text += f"L{number(point[0])} {number(point[1])}"
        else:
            text += f"L{number(x1)} {number(y1)}Q{number(point[0])} {number(point[1])} {number(x2)} {number(y2)}"
    return text + f"L{number(points[-1][0])} {number(points[-1][1])}"


def toward(corner: Point, other: Point) -> tuple[Point, float]:
    """Return the point toward `other` where the rounding of a corner ends, and the radius."""
    dx, dy = other[0] - corner[0], other[1] - corner[1]
    length = abs(dx) + abs(dy)
    radius = min(CORNER, length / 2.0)
    return (corner[0] + dx / length * radius, corner[1] + dy / length * radius) if length else corner, radius


def box(item: Box, drawing: Drawing) -> str:
    """Return the SVG of a box with its ports."""
    w, h, head = number(item.width), number(item.height), HEAD + (LINE - 2.0 if item.subtitle else 0.0)
    right, corner = number(item.width - 0.6), number(item.width - 6)
    names = f"box {item.family}" + " wrong" * bool(item.wrong)
    parts = [
        f'<g class="{names}" data-path="{escape(item.path)}" transform="translate({number(item.x)} {number(item.y)})">',
        f'<rect class="body" width="{w}" height="{h}" rx="6"/>',
        f'<path class="head" d="M.6 {head:g}V6Q.6 .6 6 .6H{corner}Q{right} .6 {right} 6V{head:g}Z"/>',
        f'<rect class="edge" width="{w}" height="{h}" rx="6"/>',
        f'<text class="title" x="{PADDING:g}" y="16.5">{escape(item.title)}</text>',
    ]
    if item.subtitle:
        parts.append(f'<text class="type" x="{PADDING:g}" y="29.5">{escape(item.subtitle)}</text>')
    for port in item.ports:
        y = number(port.y - item.y)
        inward = port.side == "in"
        names, x = ("port", PADDING) if inward else ("port end", item.width - PADDING)
        note = f' <tspan class="note">{escape(port.note)}</tspan>' if port.note else ""
        parts.append(f'<circle class="dot{" wrong" * port.wrong}" cx="{"0" if inward else w}" cy="{y}" r="2.8"/>')
        data = f' data-signal="{escape(port.signal)}"' if port.signal else ""
        parts.append(
            f'<text class="{names}"{data} x="{number(x)}" '
            f'y="{number(port.y - item.y + 3.8)}">{escape(port.name)}{note}</text>'
        )
    if item.chart:
        below = LINE * len(item.details) + 7.0 * bool(item.details)
        parts.append(chart(item.chart, item.path, PADDING, item.height - below - item.chart.height))
    for index, text in enumerate(reversed(item.details)):
        parts.append(
            f'<text class="detail" x="{PADDING:g}" y="{number(item.height - 8.0 - LINE * index)}">{escape(text)}</text>'
        )
    return "".join(parts) + "</g>"


def chart(item: Chart, path: str, x: float, y: float) -> str:
    """Return the SVG of the states and transitions of a block, whose output `state` numbers the innermost ones."""
    parts = [f'<g class="chart" data-signal="{escape(path)}.state" transform="translate({number(x)} {number(y)})">']
    for state in item.states:
        left, top = number(state.x), number(state.y)
        parts.append(
            f'<g class="state" data-number="{state.number}"><rect x="{left}" y="{top}" width="{number(state.width)}" '
            f'height="{number(state.height)}" rx="5"/>'
        )
        if state.initial:
            parts.append(f'<circle class="dot" cx="{number(state.x + 7)}" cy="{number(state.y + 8.5)}" r="2.4"/>')
        parts.append(
            f'<text class="port" x="{number(state.x + 14)}" y="{number(state.y + 12)}">{escape(state.name)}</text>'
        )
        parts += (
            f'<text class="detail" x="{number(state.x + INDENT)}" y="{number(height)}">{escape(text)}</text>'
            for text, height in state.texts
        )
        parts.append("</g>")
    for arrow in item.arrows:
        points = [(arrow.left, arrow.start), (arrow.x, arrow.start), (arrow.x, arrow.end), (arrow.right, arrow.end)]
        tip = f"M{number(arrow.right + 5)} {number(arrow.end - 3)}l-5 3l5 3"
        parts.append(f'<path class="arrow" d="{way(points)}{tip}"><title>{escape(arrow.text)}</title></path>')
    return "".join(parts) + "</g>"


def number(value: float) -> str:
    """Return the shortest text of a number with one decimal."""
    return f"{value:.1f}".rstrip("0").rstrip(".")
