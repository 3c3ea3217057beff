"""Channels: the ways of lines between columns. A line crosses a channel level, or turns onto an upright track and off
it again.

Principle: 1. every net has one wire in a channel: heights at which it comes from the left, heights at which it goes to
the right; 2. where one comes in at the height at which another goes out, the first turns off before the second turns
on; where such rules run in a circle, one wire takes two tracks; 3. wires are put in the order in which they cross
least, and each takes the leftmost track that is free; 4. feedback runs below the boxes it goes back under, in a lane of
its own.
"""

from dataclasses import dataclass, field

import networkx as nx

from graph.drawing.style import BETWEEN_BOXES, BETWEEN_LINES

NEAR = 4.0  # px, closer than this two lines look like one


@dataclass(eq=False)
class Wire:
    """A net in one channel. left, right : heights where it meets the edges of the channel. x : of its track."""

    net: object
    left: set = field(default_factory=set)
    right: set = field(default_factory=set)
    track: int = -1
    x: float = 0.0
    halves: tuple = ()  # where one track does not do: two wires that meet at a height of their own

    @property
    def heights(self):
        return self.left | self.right

    @property
    def straight(self):
        return len(self.heights) == 1

    def beside(self, other):
        """Whether the two would touch on one track."""
        return min(self.heights) - NEAR < max(other.heights) and min(other.heights) - NEAR < max(self.heights)

    def before(self, other):
        """Whether this one must turn off before the other turns on, since it comes in where the other goes out."""
        return self.net is not other.net and any(abs(a - b) < NEAR for a in self.left for b in other.right)

    def crossed_if_before(self, other):
        """How many lines cross if this one has the track on the left."""
        low, high = min(self.heights), max(self.heights)
        other_low, other_high = min(other.heights), max(other.heights)
        return sum(low < y < high for y in other.left) + sum(other_low < y < other_high for y in self.right)


def wires_of(columns, nets, hops, lanes):
    """One {net: Wire} for each channel: channel i lies left of column i, the last one right of the last column."""
    channels = [{} for _ in range(len(columns) + 1)]

    def wire(channel, net):
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


def find_lanes(columns, nets):
    """Height of each feedback net's way back: below all that stands over it, short ways above long ones."""
    floor = [max((node.y + node.height for node in column), default=0.0) for column in columns]
    back = sorted((net for net in nets if net.back), key=lambda net: span(net)[1] - span(net)[0])
    lanes, lowest = {}, list(floor)
    for net in back:
        first, last = span(net)
        under = range(first, last + 1)
        lanes[net] = max(
            max(lowest[i] + BETWEEN_LINES for i in under), max(floor[i] for i in under) + BETWEEN_BOXES * 0.75
        )
        for i in under:
            lowest[i] = lanes[net]
    return lanes


def span(net):
    """The first and the last column under which a feedback net runs."""
    return min(edge.target.layer for edge in net.edges), net.source.layer


def assign_tracks(wires):
    """Give every wire that turns a track, or two. Returns how many tracks there are."""
    turning = split_circles([wire for wire in wires if not wire.straight], {y for wire in wires for y in wire.heights})
    order = least_crossed(turning)
    order = list(nx.lexicographical_topological_sort(rules(order), key=order.index))
    for at, wire in enumerate(order):
        wire.track = 1 + max(
            (other.track for other in order[:at] if wire.beside(other) or other.before(wire)), default=-1
        )
    return 1 + max((wire.track for wire in order), default=-1)


def rules(wires):
    """Which must have its track left of which, as a graph."""
    graph = nx.DiGraph()
    graph.add_nodes_from(wires)
    graph.add_edges_from((wire, other) for wire in wires for other in wires if wire is not other and wire.before(other))
    return graph


def split_circles(wires, taken):
    """The wires, with one of every circle of `before` rules cut into two halves that meet at a height of their own."""
    wires = list(wires)
    while True:
        place = {wire: index for index, wire in enumerate(wires)}
        circle = next((knot for knot in nx.strongly_connected_components(rules(wires)) if len(knot) > 1), None)
        if circle is None:
            return wires
        wire = min(circle, key=lambda wire: (len(wire.heights), place[wire]))
        height = free_height(wire, taken)
        taken.add(height)
        wire.halves = Wire(wire.net, set(wire.left), {height}), Wire(wire.net, {height}, set(wire.right))
        wires.remove(wire)
        wires += wire.halves


def free_height(wire, taken):
    """A height inside the wire's span, if one can be, away from all that is taken."""
    middle = (min(wire.heights) + max(wire.heights)) / 2.0
    heights = (middle + NEAR * step for step in range(-400, 401))
    return min(heights, key=lambda y: (any(abs(y - other) < NEAR for other in taken), abs(y - middle)))


def least_crossed(wires):
    """An order from left to right in which few lines cross: each is put where it adds least."""
    order = []
    for wire in sorted(wires, key=lambda wire: (max(wire.heights) - min(wire.heights), min(wire.heights))):
        costs, cost = [], sum(wire.crossed_if_before(other) for other in order)
        for at in range(len(order) + 1):
            costs.append(cost)
            if at < len(order):
                cost += order[at].crossed_if_before(wire) - wire.crossed_if_before(order[at])
        at = costs.index(min(costs))
        order.insert(at, wire)
    return order
