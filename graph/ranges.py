"""Range analysis: an interval for every signal, from the `output_range` of the blocks.

A block outside loops is evaluated once, in the order of the connections. A loop is evaluated upward first, from the
start values of its blocks without direct feedthrough; a bound that keeps growing becomes infinite. The fixed point
holds at every tick, by induction: each interval contains the output of its block for the other intervals, and each loop
contains a block whose output depends on earlier inputs only. The downward pass then evaluates the blocks again, in any
order. Each result is a valid bound, so a limit inside a loop tightens the whole loop.

The number of evaluations of a block is bounded, so the work is proportional to the size of the diagram.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from graph.block import range_of
from graph.interval import EVERYTHING, Interval
from graph.signal import Signal
from graph.upstream import computes

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block
    from graph.upstream import Sources

GROWTH_LIMIT = 3  # growths of a block without direct feedthrough, after which its growing bound is infinite
UPWARD_LIMIT = 16  # evaluations of a block in the upward pass, after which its outputs are unbounded
DOWNWARD_LIMIT = 8  # evaluations of a block in the downward pass, after which its intervals remain
ZERO = Interval.point(0.0)


def find_ranges(
    blocks: Sequence[Block], order: Sequence[Block], sources: Sources, attempt: Callable[..., Any]
) -> dict[Signal, Interval]:
    """Return {Signal: Interval} for all outputs.

    blocks : all blocks; order : those with a step, in topological order
    sources : {(block, input name): Signal or array}
    attempt : called as attempt(block, hook, **intervals); calls the hook of a block, returns None if it fails
    """
    ranges = _Analysis(blocks, order, sources, attempt).ranges
    return {
        Signal(block, name): interval for block, intervals in ranges.items() for name, interval in intervals.items()
    }


def interval_of(source: np.ndarray | Signal, ranges: dict[Signal, Interval]) -> Interval:
    """Return the Interval of the source of an input: a Signal, or an array of numbers."""
    return ranges.get(source, EVERYTHING) if isinstance(source, Signal) else interval_of_numbers(source)


def interval_of_numbers(source: np.ndarray) -> Interval:
    """Return the Interval of an array of numbers."""
    return (
        Interval.point(float(source))
        if source.ndim == 0
        else Interval.point(float(source.min())) | Interval.point(float(source.max()))
    )


class _Analysis:
    """Interval propagation through a diagram, one strongly connected component after another."""

    def __init__(
        self, blocks: Sequence[Block], order: Sequence[Block], sources: Sources, attempt: Callable[..., Any]
    ) -> None:
        self.sources, self.attempt = sources, attempt
        self.ranges: dict[Block, dict[str, Interval]] = {}
        self.rank = {block: place for place, block in enumerate(order)}
        for block in blocks:
            if not computes(block) and block.outputs:  # the outputs of a device do not follow from its inputs
                self.ranges[block] = self.evaluate(block, EVERYTHING)
        self.before = {block: self.blocks_before(block) for block in order}
        self.followers: dict[Block, list[Block]] = {block: [] for block in order}
        for block, others in self.before.items():
            for other in others:
                self.followers[other].append(block)
        for component in self.components(order):
            if len(component) > 1 or component[0] in self.before[component[0]]:
                self.downward(self.upward(component), set(component))
            elif component[0].outputs:
                self.ranges[component[0]] = self.evaluate(component[0])

    def blocks_before(self, block: Block) -> list[Block]:
        """Return the blocks connected to the inputs of a block, with or without direct feedthrough."""
        sources = (self.sources[block, name] for name in block.inputs)
        return list(
            dict.fromkeys(
                source.block for source in sources if isinstance(source, Signal) and source.block in self.rank
            )
        )

    def components(self, order: Sequence[Block]) -> list[list[Block]]:
        """Return the strongly connected components as lists of blocks, in topological order."""
        from graph.order import components  # imports networkx

        return [sorted(each, key=self.rank.__getitem__) for each in components(order, self.before)]

    # One block

    def evaluate(self, block: Block, unknown: Interval | None = None) -> dict[str, Interval]:
        """Return {output: Interval} of a block from the intervals of its inputs.

        unknown : Interval for inputs without a result; None: evaluate `start_range`, with 0 at these inputs
        """
        inputs: dict[str, Interval] = {}
        hook = block.output_range
        for name in block.inputs:
            source = self.sources[block, name]
            if not isinstance(source, Signal):
                inputs[name] = interval_of_numbers(source)
            elif source.block in self.ranges:
                inputs[name] = self.ranges[source.block][source.port]
            elif unknown is not None:
                inputs[name] = unknown
            else:
                inputs[name], hook = ZERO, block.start_range
        stated = self.attempt(block, hook, **inputs)
        ranges = {name: range_of(block, name, stated) for name in block.outputs}
        # The outputs of a conditional block are 0 until it is first enabled.
        return {name: interval | ZERO for name, interval in ranges.items()} if block.conditions else ranges

    # Loops

    def upward(self, loop: Sequence[Block]) -> Sequence[Block]:
        """Grow the intervals of a loop from the start values to a fixed point.

        Returns the blocks at which the downward pass begins.
        """
        guessed: list[Block] = []
        for block in loop:
            if any(other not in self.ranges for other in self.before[block]):
                guessed.append(block)
            self.ranges[block] = self.evaluate(block)
        growths, evaluations = dict.fromkeys(loop, 0), dict.fromkeys(loop, 0)
        widened = False

        def grow(block: Block) -> bool:
            nonlocal widened
            evaluations[block] += 1
            before = self.ranges[block]
            after = {name: interval | before[name] for name, interval in self.evaluate(block).items()}
            if after == before:
                return False
            growths[block] += 1
            if evaluations[block] > UPWARD_LIMIT:
                after = dict.fromkeys(after, EVERYTHING)
                widened = True
            elif growths[block] > GROWTH_LIMIT and len(block.step_inputs()) < len(block.inputs):
                after = {name: interval.widened(before[name]) for name, interval in after.items()}
                widened = True
            self.ranges[block] = after
            return True

        self.spread(guessed, grow, set(loop))
        return loop if widened else guessed

    def downward(self, first: Sequence[Block], inside: set[Block]) -> None:
        """Narrow the intervals of a loop, beginning at the blocks `first`."""
        evaluations = dict.fromkeys(inside, 0)

        def narrow(block: Block) -> bool:
            evaluations[block] += 1
            before = self.ranges[block]
            after = {name: interval & before[name] for name, interval in self.evaluate(block).items()}
            self.ranges[block] = after
            return after != before and evaluations[block] < DOWNWARD_LIMIT

        self.spread(first, narrow, inside)

    def spread(self, first: Sequence[Block], visit: Callable[[Block], bool], inside: set[Block]) -> None:
        """Visit blocks in rounds, each in topological order, and again the followers of each block that changed.

        visit : called with a block; returns whether its intervals changed
        """
        waiting, queued = [(0, self.rank[block], block) for block in first], set(first)
        heapq.heapify(waiting)
        while waiting:
            turn, rank, block = heapq.heappop(waiting)
            queued.discard(block)
            if visit(block):
                for follower in self.followers[block]:
                    if follower in inside and follower not in queued:
                        queued.add(follower)
                        heapq.heappush(waiting, (turn + (self.rank[follower] <= rank), self.rank[follower], follower))
