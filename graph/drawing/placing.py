"""Vertical positions of the boxes in a column, with as many straight lines as possible.

In each column the boxes keep their order and their least distance, and the total vertical offset of their lines is
minimised: an isotonic regression with absolute errors, solved exactly by pooling neighbours to their weighted median
(Robertson, Wright and Dykstra 1988). The columns are solved in turn.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from graph.drawing.style import BETWEEN_BOXES, BETWEEN_LINES, ROW

if TYPE_CHECKING:
    from graph.drawing.layers import Hop, Node

Pull: TypeAlias = "tuple[float, Node, float, float, bool]"
"""A line of a node: (own port's y, other node, other port's y, weight, whether it is on the left)."""

ROUNDS = 6
FAR = 150.0  # px between two preferred positions; from this distance their mean is used
ANCHOR = 1e-3  # weight of the present position, for a box without lines


def place(columns: Sequence[list[Node]], hops: Sequence[Hop]) -> None:
    """Set the `y` of every node, the topmost at 0."""
    pulls: dict[Node, list[Pull]] = defaultdict(list)
    for hop in hops:
        out, into = hop.source.right[hop.output], hop.target.left[hop.input]
        pulls[hop.source].append((out, hop.target, into, hop.weight, False))
        pulls[hop.target].append((into, hop.source, out, hop.weight, True))
    for column in columns:
        stack(column, {node: 0.0 for node in column}, {})
    best, least = None, float("inf")
    for _turn in range(ROUNDS):
        for only_left in (True, False, None):
            for column in columns if only_left in (True, None) else reversed(columns):
                settle(column, pulls, only_left)
            bends = sum(hop.weight * abs(bend(hop)) for hop in hops)
            if bends < least - 1e-6:
                best, least = [(node, node.y) for column in columns for node in column], bends
    for node, y in best or ():
        node.y = y
    top = min((node.y for column in columns for node in column), default=0.0)
    for column in columns:
        for node in column:
            node.y = round(node.y - top)


def bend(hop: Hop) -> float:
    """Return the vertical offset of a hop in px, downwards."""
    return hop.target.y + hop.target.left[hop.input] - hop.source.y - hop.source.right[hop.output]


def settle(column: Sequence[Node], pulls: dict[Node, list[Pull]], only_left: bool | None) -> None:
    """Move the boxes of one column to the optimum for their lines.

    only_left : use the lines on the left (True), on the right (False), or all (None)
    """
    preferred: dict[Node, list[tuple[float, float]]] = {}
    for node in column:
        chosen = [pull for pull in pulls[node] if only_left is None or pull[4] == only_left] or pulls[node]
        preferred[node] = [(other.y + port - own, weight) for own, other, port, weight, _ in chosen]
    stack(column, {node: node.y for node in column}, preferred)


@dataclass
class Pool:
    """Neighbours at their least distance. preferred : (position without offset, weight) of their lines"""

    preferred: list[tuple[float, float]]
    count: int
    y: float


def stack(column: Sequence[Node], present: dict[Node, float], preferred: dict[Node, list[tuple[float, float]]]) -> None:
    """Set the heights of a column, in order and at least `gap` apart, nearest to the preferred positions."""
    pools: list[Pool] = []
    offset, above = 0.0, None
    offsets: list[float] = []
    for node in column:
        if above is not None:
            offset += above.height + gap(above, node)
        offsets.append(offset)
        own = [(y - offset, weight) for y, weight in preferred.get(node, ())] or [(present[node] - offset, ANCHOR)]
        pools.append(Pool(own, 1, median(own)))
        while len(pools) > 1 and pools[-2].y > pools[-1].y:
            lower, upper = pools.pop(), pools.pop()
            preferences = upper.preferred + lower.preferred
            pools.append(Pool(preferences, upper.count + lower.count, median(preferences)))
        above = node
    index = 0
    for pool in pools:
        for node in column[index : index + pool.count]:
            node.y = pool.y + offsets[index]
            index += 1


def gap(upper: Node, lower: Node) -> float:
    """Return the vertical distance between two neighbours of a column."""
    if upper.side and lower.side:
        return ROW
    return (
        BETWEEN_LINES
        if upper.passes and lower.passes
        else BETWEEN_BOXES * (0.75 if upper.passes or lower.passes else 1.0)
    )


def median(preferred: Sequence[tuple[float, float]]) -> float:
    """Return the weighted median of (position, weight) pairs.

    Between two positions: the upper one if they are near, so that one line is straight, else their mean.
    """
    preferred = sorted(preferred)
    half, passed = sum(weight for _, weight in preferred) / 2.0, 0.0
    for index, (y, weight) in enumerate(preferred):
        passed += weight
        if passed > half:
            return y
        if passed == half:
            following = preferred[index + 1][0]
            return y if following - y < FAR else round((y + following) / 2.0)
    return preferred[-1][0]
