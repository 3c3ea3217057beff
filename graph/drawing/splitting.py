"""Parts of a diagram in which every signal that is not in a loop runs forward.

A subsystem that senses and acts, with blocks outside between the two, is split in two at its inner boundary: the blocks
that lead out, and the blocks that the signal returns to. An actuator in a loop is split into its feedback and its
command. What remains of the loops are those that a delay closes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import networkx as nx

if TYPE_CHECKING:
    from graph.block import Block
    from graph.signal import Signal


@dataclass(eq=False)
class Part:
    """A block, or half of an actuator.

    half : "feedback" or "command" of an actuator that is split, else ""
    elements : {"euler[1]": signal} of its outputs
    chain : (name, number from 1 or 0 if not split) of the enclosing subsystems, from the outermost
    """

    block: Block
    half: str = ""
    elements: dict[str, Signal] = field(default_factory=dict[str, "Signal"])
    chain: tuple[tuple[str, int], ...] = ()

    @property
    def path(self) -> str:
        """Path of the block, with "=command" of that half: unique in a drawing."""
        return self.block.path + "=command" * (self.half == "command")


Edges: TypeAlias = "Sequence[tuple[Part, Part]]"


def loops(edges: Edges) -> dict[Part, int]:
    """Return {part: number of its loop}. Parts in no loop have a number of their own."""
    components = nx.strongly_connected_components(nx.DiGraph(edges))
    return {part: number for number, component in enumerate(components) for part in component}


def split(parts: Sequence[Part], edges: Edges, depth: int = 0) -> None:
    """Set the chain of every part below the subsystem at a depth, and join the halves that stay together."""
    groups: dict[str, list[Part]] = defaultdict(list)
    for part in parts:
        groups[part.block.path.split("/")[depth]].append(part)
    of = {part: (name, 0) for name, members in groups.items() for part in members}
    kinds = {True: [part for part in parts if part.half and is_block(part, depth)]}
    kinds[False] = [part for part in parts if not is_block(part, depth)]
    for candidates in kinds.values():  # actuators first
        while divided(of, candidates, edges):
            pass
    inner: dict[tuple[str, int], list[Part]] = defaultdict(list)
    for part in parts:
        if not is_block(part, depth):
            inner[of[part]].append(part)
        elif part.half and [of[other] for other in groups[of[part][0]]] == [of[part]] * 2:
            part.half = ""
    count = {name: len({of[part] for part in members}) for name, members in groups.items()}
    for (name, number), members in inner.items():
        for part in members:
            part.chain += ((name, number + 1 if count[name] > 1 else 0),)
        among = set(members)
        split(members, [edge for edge in edges if among.issuperset(edge)], depth + 1)


def is_block(part: Part, depth: int) -> bool:
    """Return whether a part is a block of the subsystem at a depth, not of one inside."""
    return part.block.path.count("/") == depth


def divided(of: dict[Part, tuple[str, int]], candidates: Sequence[Part], edges: Edges) -> bool:
    """Divide every group of candidates that a loop of groups passes, where it can be. Returns whether one was.

    of : {part: its group}, changed in place
    """
    among = [(one, other) for one, other in edges if one in of and other in of and of[one] != of[other]]
    loop = {
        group: number
        for number, component in enumerate(
            nx.strongly_connected_components(nx.DiGraph((of[one], of[other]) for one, other in among))
        )
        if len(component) > 1
        for group in component
    }
    looping = [edge for edge in among if loop.get(of[edge[0]], -1) == loop.get(of[edge[1]], -2)]
    members: dict[tuple[str, int], list[Part]] = defaultdict(list)
    for part in candidates:
        if of[part] in loop:
            members[of[part]].append(part)
    changed = False
    for group, inside in members.items():
        graph: nx.DiGraph[Part] = nx.DiGraph()
        graph.add_nodes_from(inside)
        graph.add_edges_from(edge for edge in edges if edge[0] in graph and edge[1] in graph)
        entered = {other for _, other in looping if of[other] == group}
        acting = reach(entered, graph.successors)
        left = {one for one, _ in looping if of[one] == group} - acting
        if not left:
            continue
        sensing = reach(left, graph.predecessors)
        rest = graph.subgraph(set(graph) - acting - sensing)
        for component in nx.weakly_connected_components(rest):  # beside the one that it is wired to
            ahead = any(other in acting for part in component for other in graph.successors(part))
            (acting if ahead else sensing).update(component)
        number = 1 + max(other for name, other in of.values() if name == group[0])
        of.update(dict.fromkeys(acting, (group[0], number)))
        changed = True
    return changed


def reach(parts: Collection[Part], beside: Callable[[Part], Iterable[Part]]) -> set[Part]:
    """Return parts and all that can be reached from them. beside : returns the neighbours of a part"""
    waiting, found = list(parts), set(parts)
    while waiting:
        following = [part for part in beside(waiting.pop()) if part not in found]
        found.update(following)
        waiting += following
    return found
