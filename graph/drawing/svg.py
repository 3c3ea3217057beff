"""A drawing as SVG: one file, no scripts, for papers and for the page."""

from html import escape
from itertools import pairwise

from graph.drawing.style import (
    BACK, CORNER, FAINT, FAMILIES, FONT, FRAME_EDGE, FRAME_FILL, FRAME_HEAD, FRAME_TITLE, HEAD, INK, LINE, PADDING, PAPER, SMALL, TEXT, TITLE, WIRE,
    WRONG,
)


def css():
    """The style sheet of the pictures."""
    rules = [
        f"text {{ font-family: {FONT}; fill: {INK}; }}",
        f".title {{ font-size: {TITLE:g}px; font-weight: 600; }} .type {{ font-size: {SMALL:g}px; fill: {FAINT}; }}",
        f".port {{ font-size: {TEXT:g}px; }} .detail, .note {{ font-size: {SMALL:g}px; fill: {FAINT}; }} .end {{ text-anchor: end; }}",
        f".paper {{ fill: {PAPER}; }} .frame > .edge {{ fill: {FRAME_FILL}; stroke: {FRAME_EDGE}; }} .frame > .head {{ fill: {FRAME_HEAD}; }}",
        f".box > .body {{ fill: {PAPER}; stroke-width: 1.2; }} .box > .dot, .joint {{ fill: {WIRE}; }}",
        f".line {{ fill: none; stroke: {WIRE}; stroke-width: 1.4; stroke-linecap: round; }} .wide {{ stroke-width: 2.8; }}",
        f".back {{ stroke: {BACK}; stroke-dasharray: 7 4; stroke-linecap: butt; }} .joint.back {{ fill: {BACK}; }}",
        f".wrong > .body {{ stroke: {WRONG}; stroke-width: 2.4; }} .line.wrong, .dot.wrong {{ stroke: {WRONG}; }}",
    ]
    rules += [
        f".{name} > .body {{ stroke: {family.edge}; }} .{name} > .head {{ fill: {family.head}; }} .{name} > .bar {{ fill: {family.edge}; }}"
        for name, family in FAMILIES.items()
    ]
    return "\n".join(rules)


def svg(drawing):
    """The whole picture as text."""
    width, height = number(drawing.width), number(drawing.height)
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" role="img">',
        f"<title>{escape(drawing.name)}</title>", f"<style>\n{css()}\n</style>", f'<rect class="paper" width="{width}" height="{height}"/>',
        *body(drawing), "</svg>", "",
    ])


def body(drawing):
    """Frames, lines, boxes, from the back to the front."""
    yield from (frame(item) for item in drawing.frames)
    for lines in nets(drawing):
        yield from (line(item, start, drawing) for item, start in zip(lines, branches(lines)))
        yield joints(lines)
    yield from (box(item, drawing) for item in drawing.boxes)


def frame(item):
    parts = [
        f'<g class="frame" data-path="{escape(item.path)}" transform="translate({number(item.x)} {number(item.y)})">',
        f'<rect class="edge" width="{number(item.width)}" height="{number(item.height)}" rx="10"/>',
        f'<path class="head" d="M.6 {FRAME_TITLE:g}V10Q.6 .6 10 .6H{number(item.width - 10)}Q{number(item.width - .6)} .6 {number(item.width - .6)} 10V{FRAME_TITLE:g}Z"/>',
        f'<text class="title" x="12" y="18">{escape(item.title)}</text>',
    ]
    if item.note:
        parts.append(f'<text class="note end" x="{number(item.width - 12)}" y="17">{escape(item.note)}</text>')
    return "".join(parts) + "</g>"


def nets(drawing):
    """Lines of one signal that go one way inside one frame, together; feedback on top."""
    found = {}
    for item in sorted(drawing.lines, key=lambda item: item.back):
        found.setdefault((item.signal, item.subsystem, item.back), []).append(item)
    return found.values()


def line(item, start, drawing):
    """A line from `start` on, px along its way: what comes before it shares with one that is drawn already."""
    names = "line" + " back" * item.back + " wide" * item.wide + " wrong" * item.wrong
    path = f'<path class="{names}" data-signal="{escape(item.signal)}" data-in="{escape(item.subsystem)}" d="{way(rest(item.points, start), item.joints)}">'
    return path + f"<title>{escape(drawing.signals.get(item.signal, item.signal))}</title></path>"


def joints(lines):
    names = "joint" + " back" * lines[0].back
    data = f'data-signal="{escape(lines[0].signal)}" data-in="{escape(lines[0].subsystem)}"'
    places = sorted({joint for item in lines for joint in item.joints})
    return "".join(f'<circle class="{names}" {data} cx="{number(x)}" cy="{number(y)}" r="2.6"/>' for x, y in places)


def branches(lines):
    """How far each of the lines from one port runs where another has been drawn, px."""
    return [max((shared(item.points, other.points) for other in lines[:index]), default=0.0) for index, item in enumerate(lines)]


def shared(one, other):
    """Length that two ways from one place have in common."""
    length = 0.0
    for (a, b), (c, d) in zip(pairwise(one), pairwise(other)):
        (dx, dy), (ex, ey) = (b[0] - a[0], b[1] - a[1]), (d[0] - c[0], d[1] - c[1])
        if dx * ey - dy * ex or dx * ex + dy * ey <= 0:
            break
        length += min(abs(dx) + abs(dy), abs(ex) + abs(ey))
        if b != d:
            break
    return length


def rest(points, start):
    """What remains of a way after `start` px of it."""
    for index, (a, b) in enumerate(pairwise(points)):
        length = abs(b[0] - a[0]) + abs(b[1] - a[1])
        if start < length:
            return [(a[0] + (b[0] - a[0]) * start / length, a[1] + (b[1] - a[1]) * start / length), *points[index + 1 :]]
        start -= length
    return points[-2:]


def way(points, joints=()):
    """The `d` of a path through the points, its corners rounded but for those where lines part."""
    text = f"M{number(points[0][0])} {number(points[0][1])}"
    for before, point, after in zip(points, points[1:], points[2:]):
        (x1, y1), r1 = toward(point, before)
        (x2, y2), r2 = toward(point, after)
        if point in joints or min(r1, r2) < 1.0:
            text += f"L{number(point[0])} {number(point[1])}"
        else:
            text += f"L{number(x1)} {number(y1)}Q{number(point[0])} {number(point[1])} {number(x2)} {number(y2)}"
    return text + f"L{number(points[-1][0])} {number(points[-1][1])}"


def toward(corner, other):
    """The point on the way from a corner where its rounding ends, and how far that is."""
    dx, dy = other[0] - corner[0], other[1] - corner[1]
    length = abs(dx) + abs(dy)
    radius = min(CORNER, length / 2.0)
    return (corner[0] + dx / length * radius, corner[1] + dy / length * radius) if length else corner, radius


def box(item, drawing):
    w, h, head = number(item.width), number(item.height), HEAD + (LINE - 2.0 if item.subtitle else 0.0)
    names = f"box {item.family}" + " wrong" * bool(item.wrong)
    parts = [
        f'<g class="{names}" data-path="{escape(item.path)}" transform="translate({number(item.x)} {number(item.y)})">',
        f'<rect class="body" width="{w}" height="{h}" rx="6"/>',
        f'<path class="head" d="M.6 {head:g}V6Q.6 .6 6 .6H{number(item.width - 6)}Q{number(item.width - .6)} .6 {number(item.width - .6)} 6V{head:g}Z"/>',
        f'<text class="title" x="{PADDING:g}" y="16.5">{escape(item.title)}</text>',
    ]
    if item.subtitle:
        parts.append(f'<text class="type" x="{PADDING:g}" y="29.5">{escape(item.subtitle)}</text>')
    for port in item.ports:
        y = number(port.y - item.y)
        inward = port.side == "in"
        place = f'x="{PADDING:g}"' if inward else f'x="{number(item.width - PADDING)}"'
        note = f' <tspan class="note">{escape(port.note)}</tspan>' if port.note else ""
        parts.append(f'<circle class="dot{" wrong" * port.wrong}" cx="{"0" if inward else w}" cy="{y}" r="2.8"/>')
        parts.append(f'<text class="port{"" if inward else " end"}" {place} y="{number(port.y - item.y + 3.8)}">{escape(port.name)}{note}</text>')
    for index, text in enumerate(reversed(item.details)):
        parts.append(f'<text class="detail" x="{PADDING:g}" y="{number(item.height - 8.0 - LINE * index)}">{escape(text)}</text>')
    return "".join(parts) + "</g>"


def number(value):
    """As short as it can be written."""
    return f"{value:.1f}".rstrip("0").rstrip(".")
