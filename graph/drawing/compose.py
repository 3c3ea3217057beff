"""Layout of a tree of subsystems: each is laid out separately and is one box in the enclosing one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import networkx as nx

from graph.device import Device
from graph.drawing import boxes, channels, layers, placing
from graph.drawing.layers import Edge, Node
from graph.drawing.model import Box, Frame, Line, Pin, Port
from graph.drawing.outline import Level
from graph.drawing.splitting import Part
from graph.drawing.style import (
    BETWEEN_BOXES,
    BETWEEN_LINES,
    CHANNEL,
    FRAME_PADDING,
    FRAME_TITLE,
    SMALL,
    TITLE,
    text_width,
)

if TYPE_CHECKING:
    from graph.compilation import Compilation
    from graph.drawing.channels import Wire
    from graph.drawing.layers import Net
    from graph.drawing.model import End, Point
    from graph.drawing.outline import Key

Route: TypeAlias = "tuple[Edge, list[Point], set[Point], bool]"
"""(edge, points, joints, whether it is feedback)"""

ASPECT = 1.6  # width to height of packed parts


@dataclass(eq=False)
class Laid:
    """Layout of a level or of a part of it: nodes and lines, with positions relative to its corner."""

    width: float = 0.0
    height: float = 0.0
    nodes: list[Node] = field(default_factory=list[Node])
    lines: list[Route] = field(default_factory=list["Route"])

    def shift(self, x: float, y: float) -> None:
        """Move all nodes and lines."""
        for node in self.nodes:
            node.x, node.y = node.x + x, node.y + y
        self.lines = [
            (edge, [(a + x, b + y) for a, b in points], {(a + x, b + y) for a, b in joints}, back)
            for edge, points, joints, back in self.lines
        ]


def lay_out(level: Level, found: Compilation, all_ports: bool, values: bool, fold: bool) -> Laid:
    """Return the Laid of a level, and set `level.laid` of it and of all levels inside.

    fold : whether a level that is like another is one box
    """
    nodes: dict[Part | Level, Node] = {}
    pins: dict[Key, Node] = {}
    for thing in level.things:
        if isinstance(thing, Level) and thing.like and fold:
            box = boxes.twin(thing)
            nodes[thing] = Node(box, box.width, box.height, box.left, box.right, frame=True)
        elif isinstance(thing, Level):
            nodes[thing] = frame_node(thing, found, all_ports, values, fold)
        else:
            box = boxes.plan(thing, found, all_ports, values, level.links.values(), level.every)
            nodes[thing] = Node(box, box.width, box.height, box.left, box.right, eager=isinstance(thing.block, Device))
    for key in level.pins:
        if key[0] != "enabled":
            inward = key[0] == "in"
            pins[key] = Node(
                key,
                left={} if inward else {key: 0.0},
                right={key: 0.0} if inward else {},
                side="first" if inward else "last",
            )

    def end(thing: Part | Level | None, key: Key) -> tuple[Node, Key]:
        return (pins[key] if thing is None else nodes[thing]), key

    edges = [Edge(*end(*link.source), *end(*link.target), link.delayed, link) for link in level.links.values()]
    parts = components([*pins.values(), *nodes.values()], edges)
    laid = [columns(part, [edge for edge in edges if edge.source in set(part)], bool(level.path)) for part in parts]
    level.laid = pack(laid, bool(level.path), bool(pins))
    return level.laid


def frame_node(level: Level, found: Compilation, all_ports: bool, values: bool, fold: bool) -> Node:
    """Return the node of a subsystem in the enclosing level."""
    inner = lay_out(level, found, all_ports, values, fold)
    heading = text_width(level.title, TITLE, bold=True) + text_width(note(level), SMALL)
    inner.width = max(inner.width, math.ceil(heading + 4 * FRAME_PADDING))
    for index, (edge, points, joints, back) in enumerate(inner.lines):  # pins are on the edge of the frame
        if edge.target.side == "last":
            inner.lines[index] = edge, [*points[:-1], (inner.width, points[-1][1])], joints, back
    inner.shift(0.0, FRAME_TITLE + FRAME_PADDING)
    inner.height += FRAME_TITLE + 2 * FRAME_PADDING
    enabled = [key for key in level.pins if key[0] == "enabled"]
    above = [(FRAME_TITLE / 2.0 + 4.0 * index, key) for index, key in enumerate(enabled)]
    left = above + [(node.y, node.what) for node in inner.nodes if node.side == "first"]
    right = [(node.y, node.what) for node in inner.nodes if node.side == "last"]
    at_left, at_right = ({key: y for y, key in sorted(pins)} for pins in (left, right))
    return Node(level, inner.width, inner.height, {**at_left}, {**at_right}, frame=True)


def note(level: Level) -> str:
    """Return what to add to the title of a subsystem: its rate, its condition, and whether it is like another."""
    words = [level.share] if level.share else []
    words += [f"every {level.every} ticks"] if level.every != 1 else []
    words += [f"as {level.like.title}"] if level.like else []
    return ", ".join(words + [f"while {key[1]}" for key in level.pins if key[0] == "enabled"])


def components(nodes: Sequence[Node], edges: Sequence[Edge]) -> list[list[Node]]:
    """Return the connected components: the one with the pins first, unconnected blocks last."""
    graph: nx.Graph[Node] = nx.Graph()
    graph.add_nodes_from(nodes)
    graph.add_edges_from((edge.source, edge.target) for edge in edges)
    pins = [node for node in nodes if node.side]
    graph.add_edges_from((pins[0], pin) for pin in pins[1:])
    position = {node: index for index, node in enumerate(nodes)}
    parts = [sorted(part, key=position.__getitem__) for part in nx.connected_components(graph)]
    return sorted(parts, key=lambda part: (not part[0].side, lone(part), position[part[0]]))


def lone(part: Sequence[Node]) -> bool:
    """Return whether a part is a block without connections, as most recorders are."""
    return len(part) == 1 and not isinstance(part[0].what, Level)


def columns(nodes: Sequence[Node], edges: Sequence[Edge], framed: bool) -> Laid:
    """Return the Laid of a connected component, in columns. framed : it is in a subsystem"""
    order, nets, hops = layers.arrange(nodes, edges)
    placing.place(order, hops)
    lanes = channels.find_lanes(order, nets)
    wires = channels.wires_of(order, nets, hops, lanes)
    x = 0.0
    for index, channel in enumerate(wires):
        tracks = channels.assign_tracks(list(channel.values()))
        inner = 0 < index < len(order)
        width = tracks * BETWEEN_LINES + (CHANNEL - BETWEEN_LINES if tracks or inner else 0.0)
        beside = [node for column in order[max(index - 1, 0) : index + 1] for node in column]
        if not inner and framed and any(node.side for node in nodes) and not any(node.side for node in beside):
            width = max(width, FRAME_PADDING)
        start = x + (width - (tracks - 1) * BETWEEN_LINES) / 2.0
        for wire in channel.values():
            for half in wire.halves or (wire,):
                half.x = round(start + half.track * BETWEEN_LINES)
        x = round(x + width)
        if index < len(order):
            widest = max(node.width for node in order[index])
            for node in order[index]:
                node.x = round(x + (widest - node.width) / 2.0)
            x += widest
    lines = [line for net in nets for line in routes(net, wires, lanes)]
    height = max([node.y + node.height for column in order for node in column] + list(lanes.values()), default=0.0)
    return Laid(x, height, [node for node in nodes], lines)


def routes(net: Net, wires: Sequence[dict[Net, Wire]], lanes: dict[Net, float]) -> Iterator[Route]:
    """Yield the Route of each edge of a net."""
    begin = net.source.x + net.source.width, net.source.y + net.source.right[net.output]
    joints = {
        joint
        for channel in wires
        if net in channel
        for half in channel[net].halves or (channel[net],)
        for joint in joints_of(half)
    }
    for edge in net.edges:
        goal = edge.target.x, edge.target.y + edge.target.left[edge.input]
        column = edge.target.layer
        points = [begin]
        if net.back:
            first = net.source.layer + 1
            points += through(wires[first][net], ("left", begin[1]), ("left", lanes[net]))
            points += through(wires[column][net], ("right", lanes[net]), ("right", goal[1]))
        else:
            for channel in range(net.source.layer + 1, column + 1):
                y = net.stops[channel].y if channel < column else goal[1]
                points += through(wires[channel][net], ("left", points[-1][1]), ("right", y))
        points = corners([*points, goal])
        yield edge, points, joints & set(points), net.back


def through(wire: Wire, enter: tuple[str, float], leave: tuple[str, float]) -> list[Point]:
    """Return the corners of a line through a channel. enter, leave : (side, height)"""
    (side, y), (other_side, other_y) = enter, leave
    if wire.halves:
        half, other = (wire.halves[where == "right"] for where in (side, other_side))
        if half is not other:
            (height,) = wire.halves[0].right
            return [(half.x, y), (half.x, height), (other.x, height), (other.x, other_y)]
        wire = half
    return [(wire.x, y), (wire.x, other_y)] if y != other_y else []


def joints_of(wire: Wire) -> Iterator[Point]:
    """Yield the points at which three segments of a net meet on its track."""
    if wire.straight:
        return
    low, high = min(wire.heights), max(wire.heights)
    for y in wire.heights:
        if (y in wire.left) + (y in wire.right) + (y > low) + (y < high) >= 3:
            yield wire.x, y


def corners(points: Sequence[Point]) -> list[Point]:
    """Return the points without those on a straight line."""
    kept = [points[0]]
    for _before, point, after in zip(points, points[1:], points[2:]):
        if point != kept[-1] and not (kept[-1][0] == point[0] == after[0] or kept[-1][1] == point[1] == after[1]):
            kept.append(point)
    return [*kept, points[-1]]


def pack(parts: Sequence[Laid], framed: bool, pinned: bool) -> Laid:
    """Pack parts in rows, with about the aspect ratio of a page.

    The part with the pins has a row of its own; unconnected blocks begin a new row.
    """
    whole = Laid()
    gap, inset = BETWEEN_BOXES * 1.25, FRAME_PADDING if framed else 0.0
    area = sum((part.width + gap) * (part.height + gap) for part in parts)
    limit = max([part.width for part in parts] + [math.sqrt(ASPECT * area)])
    x, y, row = inset, 0.0, 0.0
    for index, part in enumerate(parts):
        pins_here = pinned and index == 0
        loners = index > 0 and lone(part.nodes) and not lone(parts[index - 1].nodes)
        if not pins_here and x > inset and (x + part.width > limit + inset or loners):
            x, y, row = inset, y + row + gap, 0.0
        part.shift(0.0 if pins_here else x, y)
        x, row = x + part.width + gap, max(row, part.height)
        whole.width = max(whole.width, part.width if pins_here else x - gap + inset)
        whole.nodes += part.nodes
        whole.lines += part.lines
        if pins_here:
            x, y, row = inset, row + gap, 0.0
    whole.height = y + row if row else y - gap
    return whole


@dataclass
class Picture:
    """The parts of a drawing, from the outermost level inwards."""

    boxes: list[Box] = field(default_factory=list[Box])
    frames: list[Frame] = field(default_factory=list[Frame])
    lines: list[Line] = field(default_factory=list[Line])


def collect(level: Level, x: float, y: float, found: Compilation, picture: Picture) -> None:
    """Append the boxes, frames and lines of a level with its corner at x, y to a Picture."""
    for node in level.laid.nodes:
        left, top = node.x + x, node.y + y
        if isinstance(node.what, Level):
            inner = node.what
            pins = [Pin(key[1], key[0], left, top + offset) for key, offset in node.left.items()]
            pins += [Pin(key[1], key[0], left + node.width, top + offset) for key, offset in node.right.items()]
            picture.frames.append(
                Frame(
                    inner.path,
                    level.path,
                    inner.title,
                    note(inner),
                    left,
                    top,
                    node.width,
                    node.height,
                    tuple(pins),
                    inner.like is not None,
                )
            )
            collect(inner, left, top, found, picture)
        elif not node.side:
            picture.boxes.append(box(node, left, top, level))
    for edge, points, joints, back in level.laid.lines:
        link, target = edge.link, edge.target.what
        signal = link.signal
        wide = found.shapes.get((signal.block, signal.port), ()) != ()
        wrong = isinstance(target, boxes.Plan) and edge.input in target.wrong_ports
        picture.lines.append(
            Line(
                signal.path,
                level.path,
                name_of(level, *link.source),
                name_of(level, *link.target),
                tuple((a + x, b + y) for a, b in points),
                tuple(sorted((a + x, b + y) for a, b in joints)),
                back,
                back and link.loop,
                wide,
                wrong,
            )
        )


def name_of(level: Level, thing: Part | Level | None, key: Key) -> End:
    """Return the name of an end of a Line."""
    if isinstance(thing, Part):
        return f"{thing.block.path}.{key if isinstance(key, str) else 'enabled'}"
    side, signal = key
    return (level.path if thing is None else thing.path), side, signal


def box(node: Node, x: float, y: float, level: Level) -> Box:
    """Return the Box of a block, with its ports, at a position."""
    plan: boxes.Plan = node.what
    ports = [
        Port(plan.labels[key], "in", x, y + offset, plan.notes.get(key, ""), key in plan.wrong_ports)
        for key, offset in plan.left.items()
    ]
    ports += [
        Port(
            plan.labels[key],
            "out",
            x + node.width,
            y + offset,
            plan.notes.get(key, ""),
            signal=plan.signals.get(key, ""),
        )
        for key, offset in plan.right.items()
    ]
    return Box(
        plan.path,
        level.path,
        plan.family,
        plan.title,
        plan.subtitle,
        plan.details,
        x,
        y,
        node.width,
        node.height,
        tuple(ports),
        plan.wrong,
        plan.chart,
    )
