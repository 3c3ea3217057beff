"""Channel routing: the lines between columns. A line crosses a channel horizontally or by a vertical track.

Principle of operation: 1. A net has one wire in each channel, with the heights of its ends on the left and on the
right. 2. If one wire enters at the height at which another leaves, the track of the first must be left of the track of
the second. If these constraints form a cycle, one wire is split over two tracks. 3. The wires are ordered for few
crossings, and each takes the leftmost free track. 4. Feedback runs in a lane of its own below the boxes that it passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import networkx as nx

from graph.drawing.style import BETWEEN_BOXES, BETWEEN_LINES

if TYPE_CHECKING:
    from graph.drawing.layers import Hop, Net, Node

NEAR = 4.0  # px, distance below which two lines cannot be distinguished


@dataclass(eq=False)
class Wire:
    """A net in one channel. left, right : heights of its ends at the edges of the channel; x : position of its track"""

    net: Net
    left: set[float] = field(default_factory=set[float])
    right: set[float] = field(default_factory=set[float])
    track: int = -1
    x: float = 0.0
    halves: tuple[Wire, ...] = ()  # of a wire split over two tracks: two wires that meet at a free height

    @property
    def heights(self) -> set[float]:
        """Heights of all ends."""
        return self.left | self.right

    @property
    def straight(self) -> bool:
        """Whether the wire needs no track."""
        return len(self.heights) == 1

    def beside(self, other: Wire) -> bool:
        """Return whether two wires overlap on one track."""
        return min(self.heights) - NEAR < max(other.heights) and min(other.heights) - NEAR < max(self.heights)

    def before(self, other: Wire) -> bool:
        """Return whether the track of this wire must be left of the other's: it enters where the other leaves."""
        return self.net is not other.net and any(abs(a - b) < NEAR for a in self.left for b in other.right)

    def crossed_if_before(self, other: Wire) -> int:
        """Return the number of crossings if the track of this wire is left of the other's."""
        low, high = min(self.heights), max(self.heights)
        other_low, other_high = min(other.heights), max(other.heights)
        return sum(low < y < high for y in other.left) + sum(other_low < y < other_high for y in self.right)


def wires_of(
    columns: Sequence[list[Node]], nets: Sequence[Net], hops: Sequence[Hop], lanes: dict[Net, float]
) -> list[dict[Net, Wire]]:
    """Return {net: Wire} of each channel: channel i is left of column i, the last right of the last column."""
    channels: list[dict[Net, Wire]] = [{} for _ in range(len(columns) + 1)]

    def wire(channel: int, net: Net) -> Wire:
        return channels[channel].setdefault(net, Wire(net))

    for hop in hops:
        place = wire(hop.source.layer + 1, hop.net)
        place.left.add(hop.source.y + hop.source.right[hop.output])
        place.right.add(hop.target.y + hop.target.left[hop.input])
    for net in nets:
        if net.back:
            begin, end = net.source.layer + 1, min(edge.target.layer for edge in net.edges)
            wire(begin, net).left |= {net.source.y + net.source.right[net.output], lanes[net]}
            for channel in range(end, begin):
                heights = {
                    edge.target.y + edge.target.left[edge.input] for edge in net.edges if edge.target.layer == channel
                }
                if heights:
                    wire(channel, net).right |= heights | {lanes[net]}
                    if channel > end:
                        wire(channel, net).left.add(lanes[net])
    return channels


def find_lanes(columns: Sequence[list[Node]], nets: Sequence[Net]) -> dict[Net, float]:
    """Return {feedback net: height of its lane}: below the boxes that it passes, short lanes above long ones."""
    floor = [max((node.y + node.height for node in column), default=0.0) for column in columns]
    back = sorted((net for net in nets if net.back), key=lambda net: span(net)[1] - span(net)[0])
    lanes: dict[Net, float] = {}
    lowest = list(floor)
    for net in back:
        first, last = span(net)
        under = range(first, last + 1)
        lanes[net] = max(
            max(lowest[i] + BETWEEN_LINES for i in under), max(floor[i] for i in under) + BETWEEN_BOXES * 0.75
        )
        for i in under:
            lowest[i] = lanes[net]
    return lanes


def span(net: Net) -> tuple[int, int]:
    """Return the first and the last column below which a feedback net runs."""
    return min(edge.target.layer for edge in net.edges), net.source.layer


def assign_tracks(wires: Sequence[Wire]) -> int:
    """Assign a track to every wire that is not straight, two to a split wire. Returns the number of tracks."""
    turning = split_cycles([wire for wire in wires if not wire.straight], {y for wire in wires for y in wire.heights})
    order = least_crossed(turning)
    order = list(nx.lexicographical_topological_sort(rules(order), key=order.index))
    for at, wire in enumerate(order):
        wire.track = 1 + max(
            (other.track for other in order[:at] if wire.beside(other) or other.before(wire)), default=-1
        )
    return 1 + max((wire.track for wire in order), default=-1)


def rules(wires: Sequence[Wire]) -> nx.DiGraph[Wire]:
    """Return the graph of constraints: an edge from a wire to each whose track must be right of its own."""
    graph: nx.DiGraph[Wire] = nx.DiGraph()
    graph.add_nodes_from(wires)
    graph.add_edges_from((wire, other) for wire in wires for other in wires if wire is not other and wire.before(other))
    return graph


def split_cycles(wires: Sequence[Wire], taken: set[float]) -> list[Wire]:
    """Return the wires, with one wire of each cycle of constraints split into two halves."""
    wires = list(wires)
    while True:
        place = {wire: index for index, wire in enumerate(wires)}
        components = nx.strongly_connected_components(rules(wires))
        cycle = next((component for component in components if len(component) > 1), None)
        if cycle is None:
            return wires
        wire = min(cycle, key=lambda wire: (len(wire.heights), place[wire]))
        height = free_height(wire, taken)
        taken.add(height)
        wire.halves = Wire(wire.net, set(wire.left), {height}), Wire(wire.net, {height}, set(wire.right))
        wires.remove(wire)
        wires += wire.halves


def free_height(wire: Wire, taken: set[float]) -> float:
    """Return a free height, as near as possible to the middle of a wire. taken : heights in use"""
    middle = (min(wire.heights) + max(wire.heights)) / 2.0
    heights = (middle + NEAR * step for step in range(-400, 401))
    return min(heights, key=lambda y: (any(abs(y - other) < NEAR for other in taken), abs(y - middle)))


def least_crossed(wires: Sequence[Wire]) -> list[Wire]:
    """Return the wires in an order with few crossings: each is inserted where it adds the fewest."""
    order: list[Wire] = []
    for wire in sorted(wires, key=lambda wire: (max(wire.heights) - min(wire.heights), min(wire.heights))):
        costs: list[int] = []
        cost = sum(wire.crossed_if_before(other) for other in order)
        for at in range(len(order) + 1):
            costs.append(cost)
            if at < len(order):
                cost += order[at].crossed_if_before(wire) - wire.crossed_if_before(order[at])
        at = costs.index(min(costs))
        order.insert(at, wire)
    return order
