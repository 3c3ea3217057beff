"""Range analysis: an interval for every signal, from what blocks say of their outputs.

Blocks outside loops are asked once, in the order of the wires. A loop is asked upward first, from where its blocks
without direct feedthrough start; an end that keeps growing there becomes infinite. What has come to rest so is true at
every tick, by induction: each interval holds what its block makes of the others, and each loop holds a block that shows
only what came in before. Then downward: whatever follows from what is true is true, in any order, so that a limit
inside a loop reaches all of it.

Every block is asked a bounded number of times, so the work grows with the size of the diagram.
"""

import heapq

from graph.block import range_of
from graph.interval import EVERYTHING, Interval
from graph.order import computes
from graph.signal import Signal

GROWTHS = 3  # after so many an end of a block without direct feedthrough is infinite
ASKED = 16  # after so many questions on the way up nothing is said of a block
NARROWED = 8  # and after so many on the way down it stays as it is
ZERO = Interval.point(0.0)


def find_ranges(blocks, order, sources, attempt):
    """{Signal: Interval}.

    blocks, order : all of them, and those that compute in their topological order
    sources : {(block, input name): Signal or array}
    attempt(block, hook, **intervals) calls a hook of a block's author; None where it fails
    """
    found = _Analysis(blocks, order, sources, attempt).found
    return {Signal(block, name): interval for block, intervals in found.items() for name, interval in intervals.items()}


def interval_of(source, ranges):
    """Of what is wired to an input: a Signal, or an array of numbers."""
    return ranges.get(source, EVERYTHING) if isinstance(source, Signal) else interval_of_numbers(source)


def interval_of_numbers(source):
    """Return the Interval of an array of numbers."""
    return (
        Interval.point(float(source))
        if source.ndim == 0
        else Interval.point(float(source.min())) | Interval.point(float(source.max()))
    )


class _Analysis:
    def __init__(self, blocks, order, sources, attempt):
        self.sources, self.attempt = sources, attempt
        self.found = {}  # block: {output: Interval}
        self.rank = {block: place for place, block in enumerate(order)}
        for block in blocks:
            if not computes(block) and block.outputs:  # a device measures the world: what it says follows from no wire
                self.found[block] = self.ask(block, EVERYTHING)
        self.before = {block: self.blocks_before(block) for block in order}
        self.followers = {block: [] for block in order}
        for block, others in self.before.items():
            for other in others:
                self.followers[other].append(block)
        for component in self.components(order):
            if len(component) > 1 or component[0] in self.before[component[0]]:
                self.downward(self.upward(component), set(component))
            elif component[0].outputs:
                self.found[component[0]] = self.ask(component[0])

    def blocks_before(self, block):
        """The blocks whose intervals those of a block follow from, with or without direct feedthrough."""
        found = (self.sources[block, name] for name in block.inputs)
        return list(
            dict.fromkeys(source.block for source in found if isinstance(source, Signal) and source.block in self.rank)
        )

    def components(self, order):
        """Lists of blocks, each loop one and every other block alone, each behind those that it follows from. (Tarjan
        1972)
        """
        number, lowest, stack, standing = {}, {}, [], set()
        for root in order:
            path = [] if root in number else [(root, iter(self.before[root]))]
            while path:
                block, others = path[-1]
                if block not in number:
                    number[block] = lowest[block] = len(number)
                    stack.append(block)
                    standing.add(block)
                for other in others:
                    if other not in number:
                        path.append((other, iter(self.before[other])))
                        break
                    if other in standing:
                        lowest[block] = min(lowest[block], lowest[other])
                else:
                    path.pop()
                    if path:
                        lowest[path[-1][0]] = min(lowest[path[-1][0]], lowest[block])
                    if lowest[block] == number[block]:
                        component = [stack.pop()]
                        while component[-1] is not block:
                            component.append(stack.pop())
                        standing.difference_update(component)
                        yield sorted(component, key=self.rank.__getitem__)

    # One block

    def ask(self, block, unknown=None):
        """{output: Interval}, from what is known of its inputs; where that is nothing, what the block starts with."""
        inputs, hook = {}, block.output_range
        for name in block.inputs:
            source = self.sources[block, name]
            if not isinstance(source, Signal):
                inputs[name] = interval_of_numbers(source)
            elif source.block in self.found:
                inputs[name] = self.found[source.block][source.port]
            elif unknown is not None:
                inputs[name] = unknown
            else:
                inputs[name], hook = ZERO, block.start_range
        said = self.attempt(block, hook, **inputs)
        found = {name: range_of(block, name, said) for name in block.outputs}
        # A block with a condition shows 0 until it has been enabled.
        return {name: interval | ZERO for name, interval in found.items()} if block.conditions else found

    # Loops

    def upward(self, loop):
        """From what the blocks start with to what holds all that follows; returns the blocks from where it may be
        narrowed.
        """
        inside, guessed = set(loop), []
        for block in loop:
            if any(other not in self.found for other in self.before[block]):
                guessed.append(block)
            self.found[block] = self.ask(block)
        growths, asked, widened = dict.fromkeys(loop, 0), dict.fromkeys(loop, 0), []

        def grow(block):
            asked[block] += 1
            before = self.found[block]
            after = {name: interval | before[name] for name, interval in self.ask(block).items()}
            if after == before:
                return False
            growths[block] += 1
            if asked[block] > ASKED:
                after = dict.fromkeys(after, EVERYTHING)
                widened.append(block)
            elif growths[block] > GROWTHS and len(block.step_inputs()) < len(block.inputs):
                after = {name: interval.widened(before[name]) for name, interval in after.items()}
                widened.append(block)
            self.found[block] = after
            return True

        self.spread(guessed, grow, inside)
        return loop if widened else guessed

    def downward(self, first, inside):
        asked = dict.fromkeys(inside, 0)

        def narrow(block):
            asked[block] += 1
            before = self.found[block]
            after = {name: interval & before[name] for name, interval in self.ask(block).items()}
            self.found[block] = after
            return after != before and asked[block] < NARROWED

        self.spread(first, narrow, inside)

    def spread(self, first, visit, inside):
        """Visit blocks round by round, in each the way signals go, and again what follows one whose visit says that it
        has changed.
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
