"""Order of the steps in a tick: the dependencies are a graph of networkx, which sorts it and finds its loops.

The import of networkx takes 0.1 s and 20 MB, so that only a compile imports this module.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import networkx as nx

from graph.signal import Signal
from graph.upstream import computes

if TYPE_CHECKING:
    from graph.block import Block
    from graph.upstream import Sources

    Graph: TypeAlias = nx.DiGraph[Block]


def dependencies(blocks: Sequence[Block], sources: Sources) -> Graph:
    """Return the direct feedthroughs and conditions among blocks, as a DiGraph of the blocks that compute.

    The attributes `source` and `port` of an edge are the names of the output and of the input.
    """
    graph: Graph = nx.DiGraph()
    graph.add_nodes_from(block for block in blocks if computes(block))
    for block in graph:
        for name in block.step_inputs():
            source = sources.get((block, name))
            if (
                isinstance(source, Signal)
                and source.block in graph
                and source.port not in getattr(source.block, "sent_outputs", ())
            ):
                graph.add_edge(source.block, block, port=name, source=source.port)
        for condition in block.conditions:
            if condition.block in graph:
                graph.add_edge(condition.block, block, port="enabled", source=condition.port)
    return graph


def take_out_loops(graph: Graph) -> list[list[tuple[Block, str, Block, str]]]:
    """Remove the edges of algebraic loops from the dependencies.

    Returns one cycle of each loop, as a list of (block, output, block, input).
    """
    cycles: list[list[tuple[Block, str, Block, str]]] = []
    for component in list(nx.strongly_connected_components(graph)):
        inside = graph.subgraph(component)
        if not inside.number_of_edges():
            continue
        first = min(component, key=lambda block: block.path)
        first = next((block for block in [first, *inside] if inside.has_edge(block, block)), first)
        cycles.append(
            [(a, inside.edges[a, b]["source"], b, inside.edges[a, b]["port"]) for a, b in shortest_cycle(inside, first)]
        )
        graph.remove_edges_from(list(inside.edges))
    return cycles


def shortest_cycle(graph: Graph, first: Block) -> list[tuple[Block, Block]]:
    """Return the edges of a shortest cycle through a block."""
    if graph.has_edge(first, first):
        return [(first, first)]
    paths = nx.single_source_shortest_path(graph, first)
    last = min(graph.predecessors(first), key=lambda block: (len(paths[block]), block.path))
    around = paths[last] + [first]
    return list(zip(around, around[1:]))


def ordered(graph: Graph) -> list[Block]:
    """Return the blocks of an acyclic graph in the topological order of networkx, by a key.

    The first part of the key is the number of changes of kind on the way to a block, so that steps of one kind are
    adjacent and the GIL is acquired seldom; the kinds of a level alternate, so that two levels meet in one. Within a
    segment the order is by depth, then by class: indirect calls are predicted better, and consecutive steps seldom
    depend on each other.
    """
    kinds = {block: kind(block) for block in graph}
    level, depth = dict.fromkeys(graph, 0), dict.fromkeys(graph, 0)  # changes of kind, blocks on the longest way
    for block in nx.topological_sort(graph):
        for follower in graph[block]:
            level[follower] = max(level[follower], level[block] + (kinds[block] != kinds[follower]))
            depth[follower] = max(depth[follower], depth[block] + 1)
    ranks = {each: rank for rank, each in enumerate(sorted(set(kinds.values())))}

    def key(block: Block) -> tuple[Any, ...]:
        own, rank = type(block), ranks[kinds[block]]
        return (
            level[block],
            rank if level[block] % 2 == 0 else -rank,
            depth[block],
            own.__module__,
            own.__qualname__,
            block.path,
        )

    return list(nx.lexicographical_topological_sort(graph, key))


def kind(block: Block) -> tuple[int, tuple[str, ...], bool]:
    """Return the key that all steps of a segment share: rate, conditions, whether they run in Python."""
    return block.every, tuple(condition.path for condition in block.conditions), block.is_python


def components(blocks: Iterable[Block], before: Mapping[Block, Iterable[Block]]) -> list[list[Block]]:
    """Return the strongly connected components of blocks, in topological order.

    before : {block: the blocks that are connected to its inputs}
    """
    graph: Graph = nx.DiGraph()
    graph.add_nodes_from(blocks)
    graph.add_edges_from((other, block) for block in graph for other in before[block])
    condensed = nx.condensation(graph)
    return [list(condensed.nodes[each]["members"]) for each in nx.topological_sort(condensed)]
