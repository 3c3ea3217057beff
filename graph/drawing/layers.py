"""Layered layout: the column of each box of a level, and the order in each column.

Principle of operation: 1. Links that close a loop become feedback, preferably those without direct feedthrough, and all
links between two subsystems that feed each other, such as left and right, which are one above the other. 2. Each box is
in the leftmost column that its sources permit. 3. A link over several columns has a node in each of them, so
that it passes between boxes. 4. Each column is sorted by the mean position of the neighbours, forwards and backwards,
until the number of crossings no longer decreases. (Sugiyama, Tagawa and Toda 1981; Gansner et al. 1993)
"""

from __future__ import annotations

from bisect import bisect, insort
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import networkx as nx

if TYPE_CHECKING:
    from graph.drawing.outline import Key

SWEEP_LIMIT = 12  # sorting passes over all columns


@dataclass(eq=False)
class Node:
    """A box, a frame, a pin, or the passage of a line through a column.

    left, right : {port: y from the top} in px
    side : "first" or "last" for pins, which are in the outermost columns
    """

    what: Any
    width: float = 0.0
    height: float = 0.0
    left: dict[Key, float] = field(default_factory=dict["Key", float])
    right: dict[Key, float] = field(default_factory=dict["Key", float])
    side: str = ""
    eager: bool = False  # a device: the preferred place to open a loop
    frame: bool = False  # a subsystem
    layer: int = 0
    x: float = 0.0
    y: float = 0.0

    @property
    def passes(self) -> bool:
        """Whether it is the passage of a line through a column."""
        return isinstance(self.what, Net)


@dataclass(eq=False)
class Edge:
    """A link from an output of one node to an input of another."""

    source: Node
    output: Key
    target: Node
    input: Key
    delayed: bool = False
    link: Any = None  # outline.Link


@dataclass(eq=False)
class Net:
    """All edges of one output in one direction. stops : its node in each column that it passes"""

    source: Node
    output: Key
    back: bool
    edges: list[Edge] = field(default_factory=list[Edge])
    stops: dict[int, Node] = field(default_factory=dict[int, Node])  # column: Node


@dataclass(frozen=True)
class Hop:
    """A segment of a net between adjacent columns."""

    source: Node
    output: Key
    target: Node
    input: Key
    net: Net

    @property
    def weight(self) -> float:
        """Weight of the vertical offset, higher for segments of long lines. (Gansner et al. 1993)"""
        return (1.0, 2.0, 8.0)[self.source.passes + self.target.passes]


def arrange(nodes: Sequence[Node], edges: Sequence[Edge]) -> tuple[list[list[Node]], list[Net], list[Hop]]:
    """Set the `layer` of every node. Returns (columns of nodes, nets, hops).

    The order of `nodes` resolves ties.
    """
    back = feedback(nodes, edges)
    find_layers(nodes, [edge for edge in edges if edge not in back])
    back = {edge for edge in back if edge.target.layer <= edge.source.layer}
    nets: dict[tuple[Node, Key, bool], Net] = {}
    for edge in edges:
        key = edge.source, edge.output, edge in back
        nets.setdefault(key, Net(*key)).edges.append(edge)
    columns: list[list[Node]] = [[] for _ in range(1 + max((node.layer for node in nodes), default=0))]
    for node in nodes:
        columns[node.layer].append(node)
    hops = [hop for net in nets.values() if not net.back for hop in pass_through(net, columns)]
    return uncross(columns, hops), list(nets.values()), hops


def feedback(nodes: Sequence[Node], edges: Sequence[Edge]) -> set[Edge]:
    """Return a set of feedback edges, without which there is no loop."""
    position = {node: index for index, node in enumerate(nodes)}
    ends = {(edge.source, edge.target) for edge in edges if edge.source.frame and edge.target.frame}
    mutual = {(source, target) for source, target in ends if (target, source) in ends}
    back = {edge for edge in edges if edge.source is edge.target or (edge.source, edge.target) in mutual}
    while True:
        remaining = [edge for edge in edges if edge not in back]
        graph = nx.DiGraph((edge.source, edge.target) for edge in remaining)
        loops = [component for component in nx.strongly_connected_components(graph) if len(component) > 1]
        if not loops:
            return back
        for loop in loops:
            inside = [edge for edge in remaining if edge.source in loop and edge.target in loop]
            back |= opening(inside, position)


def opening(edges: Sequence[Edge], position: dict[Node, int]) -> set[Edge]:
    """Return the edges into the node of a loop at which the flow should begin."""
    entering: dict[Node, list[Edge]] = defaultdict(list)
    leaving: dict[Node, int] = defaultdict(int)
    for edge in edges:
        entering[edge.target].append(edge)
        leaving[edge.source] += 1

    def reluctance(node: Node) -> tuple[bool, bool, bool, int, int]:
        needed = sum(not edge.delayed for edge in entering[node])
        return (
            needed == len(entering[node]),
            needed > 0,
            not node.eager,
            len(entering[node]) - leaving[node],
            position[node],
        )

    start = min(entering, key=reluctance)
    delayed = {edge for edge in entering[start] if edge.delayed}
    return delayed or set(entering[start])


def find_layers(nodes: Sequence[Node], edges: Sequence[Edge]) -> None:
    """Set layers by the longest path from the left; a source is in the column before its first target."""
    followers: dict[Node, list[Node]] = defaultdict(list)
    waiting = dict.fromkeys(nodes, 0)
    for edge in edges:
        followers[edge.source].append(edge.target)
        waiting[edge.target] += 1
    has_input = {node for node, count in waiting.items() if count}
    first = any(node.side == "first" for node in nodes)
    ready = [node for node in nodes if not waiting[node]]
    for node in nodes:
        node.layer = int(first and node.side != "first")
    for node in ready:  # grows during the iteration
        for follower in followers[node]:
            follower.layer = max(follower.layer, node.layer + 1)
            waiting[follower] -= 1
            if not waiting[follower]:
                ready.append(follower)
    for node in nodes:
        if node not in has_input and node.side != "first" and followers[node]:
            node.layer = min(follower.layer for follower in followers[node]) - 1
    last = max((node.layer + 1 for node in nodes if node.side != "last"), default=0)
    for node in nodes:
        if node.side == "last":
            node.layer = last


def pass_through(net: Net, columns: Sequence[list[Node]]) -> list[Hop]:
    """Return the hops of a net, with a stop in each column between its source and its furthest target."""
    at: tuple[Node, Key] = (net.source, net.output)
    hops: list[Hop] = []
    last = max(edge.target.layer for edge in net.edges)
    for column in range(net.source.layer + 1, last + 1):
        hops += [Hop(*at, edge.target, edge.input, net) for edge in net.edges if edge.target.layer == column]
        if column < last:
            stop = net.stops[column] = Node(net, left={"": 0.0}, right={"": 0.0}, layer=column)
            columns[column].append(stop)
            hops.append(Hop(*at, stop, "", net))
            at = stop, ""
    return hops


def uncross(columns: Sequence[list[Node]], hops: Sequence[Hop]) -> list[list[Node]]:
    """Return the columns, each in an order with few crossings."""
    entering: dict[Node, list[Hop]] = defaultdict(list)
    leaving: dict[Node, list[Hop]] = defaultdict(list)
    for hop in hops:
        entering[hop.target].append(hop)
        leaving[hop.source].append(hop)
    order = [list(column) for column in columns]
    best, fewest = order, crossings(order, leaving)
    for sweep in range(SWEEP_LIMIT):
        if not fewest:
            break
        order = [list(column) for column in order]
        forth = sweep % 2 == 0
        for index in range(1, len(order)) if forth else range(len(order) - 2, -1, -1):
            sort_column(order, index, entering if forth else leaving, forth)
        swap_neighbours(order, entering, leaving)
        count = crossings(order, leaving)
        if count < fewest:
            best, fewest = order, count
    return best


def sort_column(order: list[list[Node]], index: int, hops: dict[Node, list[Hop]], forth: bool) -> None:
    """Sort a column by the mean position of the linked nodes in the adjacent column.

    A node without links keeps its relative position.
    """
    beside = places(order[index - 1 if forth else index + 1])
    column = order[index]

    def place(at: int, node: Node) -> float:
        if forth:
            linked = [beside[hop.source] + share(hop.source.right, hop.output) for hop in hops[node]]
        else:
            linked = [beside[hop.target] + share(hop.target.left, hop.input) for hop in hops[node]]
        return sum(linked) / len(linked) if linked else at * len(beside) / len(column)

    means = {node: place(at, node) for at, node in enumerate(column)}
    order[index] = sorted(column, key=means.__getitem__)


def swap_neighbours(
    order: Sequence[list[Node]], entering: dict[Node, list[Hop]], leaving: dict[Node, list[Hop]]
) -> None:
    """Swap adjacent nodes of a column while that reduces the crossings of their lines."""
    for index, column in enumerate(order):
        before = places(order[index - 1]) if index else {}
        behind = places(order[index + 1]) if index + 1 < len(order) else {}
        ends = {
            node: (
                [before[hop.source] + share(hop.source.right, hop.output) for hop in entering[node]],
                [behind[hop.target] + share(hop.target.left, hop.input) for hop in leaving[node]],
            )
            for node in column
        }
        better = True
        while better:
            better = False
            for at in range(len(column) - 1):
                upper, lower = ends[column[at]], ends[column[at + 1]]
                now = sum(sum(a > b for a in one for b in other) for one, other in zip(upper, lower))
                then = sum(sum(a < b for a in one for b in other) for one, other in zip(upper, lower))
                if then < now:
                    column[at], column[at + 1] = column[at + 1], column[at]
                    better = True


def crossings(order: Sequence[list[Node]], leaving: dict[Node, list[Hop]]) -> int:
    """Return the number of pairs of hops that cross."""
    count = 0
    for column, following in pairwise(order):
        here, there = places(column), places(following)
        ends = sorted(
            (here[node] + share(node.right, hop.output), there[hop.target] + share(hop.target.left, hop.input))
            for node in column
            for hop in leaving[node]
        )
        seen: list[float] = []
        for _, end in ends:
            count += len(seen) - bisect(seen, end)
            insort(seen, end)
    return count


def places(column: Sequence[Node]) -> dict[Node, int]:
    """Return {node: index} of a column."""
    return {node: index for index, node in enumerate(column)}


def share(ports: dict[Key, float], port: Key) -> float:
    """Return the relative position of a port on its edge, from 0 to 1."""
    return (list(ports).index(port) + 1) / (len(ports) + 1)
