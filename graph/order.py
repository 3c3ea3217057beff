"""Order of the steps in a tick: dependencies, algebraic loops, and segments of one kind."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import TYPE_CHECKING

from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np
    from networkx.classes.digraph import DiGraph

    from graph.block import Block
    from graph.schedule import Step

    Followers = dict[Block, dict[Block, dict[str, str]]]


def computes(block: Block) -> bool:
    """Return whether a block has a step in the output phase."""
    return block.is_python or block.kernel is not None


def dependencies(blocks: Sequence[Block], sources: dict[tuple[Block, str], np.ndarray | Signal]) -> Followers:
    """Return the direct feedthroughs and conditions among blocks: {block: {follower: {"source": .., "port": ..}}}.

    `source` and `port` are the names of the output and of the input.
    """
    graph: Followers = {block: {} for block in blocks if computes(block)}
    for block in graph:
        for name in block.step_inputs():
            source = sources.get((block, name))
            if (
                isinstance(source, Signal)
                and source.block in graph
                and source.port not in getattr(source.block, "sent_outputs", ())
            ):
                graph[source.block][block] = {"port": name, "source": source.port}
        for condition in block.conditions:
            if condition.block in graph:
                graph[condition.block][block] = {"port": "enabled", "source": condition.port}
    return graph


def upstream(blocks: dict[Block, Step], sources: dict[tuple[Block, str], np.ndarray | Signal]) -> set[Block]:
    """Return the blocks and all upstream of them, with or without direct feedthrough, as a set."""
    reached, waiting = set(blocks), list(blocks)
    while waiting:
        block = waiting.pop()
        for source in (*(sources.get((block, name)) for name in block.inputs), *block.conditions):
            if isinstance(source, Signal) and source.block not in reached:
                reached.add(source.block)
                waiting.append(source.block)
    return reached


def take_out_loops(graph: Followers) -> list[list[tuple[Block, str, Block, str]]]:
    """Remove the edges of algebraic loops from the dependencies.

    Returns one cycle of each loop, as a list of (block, output, block, input).
    """
    import networkx as nx  # 20 MB and 0.1 s

    digraph = nx.DiGraph(graph)
    cycles = []
    for component in list(nx.strongly_connected_components(digraph)):
        if len(component) == 1 and not digraph.has_edge(*component, *component):
            continue
        inside = digraph.subgraph(component)
        first = min(component, key=lambda block: block.path)
        first = next((block for block in [first, *inside] if inside.has_edge(block, block)), first)
        cycles.append(
            [(a, inside.edges[a, b]["source"], b, inside.edges[a, b]["port"]) for a, b in shortest_cycle(inside, first)]
        )
        for block in component:
            graph[block] = {other: names for other, names in graph[block].items() if other not in component}
    return cycles


def shortest_cycle(graph: DiGraph, first: Block) -> list[tuple[Block, Block]]:
    """Return the edges of a shortest cycle through a block."""
    if graph.has_edge(first, first):
        return [(first, first)]
    from networkx import shortest_path

    paths = shortest_path(graph, first)
    last = min(graph.predecessors(first), key=lambda block: (len(paths[block]), block.path))
    around = paths[last] + [first]
    return list(zip(around, around[1:]))


def cluster(graph: Followers) -> list[Block]:
    """Return the blocks in a topological order with few changes between native and Python segments.

    Steps of one kind and rate are adjacent, which minimises GIL acquisitions. Within a segment the order is by depth,
    then by class: indirect calls are predicted better, and consecutive steps seldom depend on each other. The blocks of
    a loop and their followers are missing.
    """
    waiting = dict.fromkeys(graph, 0)
    for followers in graph.values():
        for follower in followers:
            waiting[follower] += 1
    depth = dict.fromkeys(graph, 0)  # length of the longest path from a source
    ready = {}  # kind: heap of (depth, class, path, block)

    def release(block):
        own = type(block)
        heapq.heappush(
            ready.setdefault(kind(block), []), (depth[block], own.__module__, own.__qualname__, block.path, block)
        )

    for block, count in waiting.items():
        if count == 0:
            release(block)
    order, current = [], None
    while ready:
        current = current if current in ready else min(ready)
        *_, block = heapq.heappop(ready[current])
        if not ready[current]:
            del ready[current]
        order.append(block)
        for follower in graph[block]:
            waiting[follower] -= 1
            depth[follower] = max(depth[follower], depth[block] + 1)
            if waiting[follower] == 0:
                release(follower)
    return order


def kind(block: Block) -> tuple[int, tuple[str, ...], bool]:
    """Return the key that all steps of a segment share: rate, conditions, whether they run in Python."""
    return block.every, tuple(condition.path for condition in block.conditions), block.is_python
