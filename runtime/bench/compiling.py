"""How long a compile takes, and how that grows with the diagram."""

import math
import time

from graph import compile
from runtime.bench.measure import Times
from runtime.bench.netlists import wide
from runtime.bench.ours import diagram_of, native_block
from runtime.console.progress import rounds

LANES = {8: 9, 41: 5, 416: 3}  # of the wide diagram: 200, 992 and 9992 blocks; and how often each is compiled


class Compiles:
    """blocks : of the diagram. build, compile : Times, in ms"""

    def __init__(self, lanes, repeats):
        built, compiled = [], []
        for _ in rounds("compiling", repeats):
            began = time.thread_time()
            diagram = diagram_of(wide(lanes), native_block)
            ready = time.thread_time()
            compile(diagram)
            compiled.append((time.thread_time() - ready) * 1e3)
            built.append((ready - began) * 1e3)
        self.blocks = len(diagram)
        self.build, self.compile = Times(built), Times(compiled)


def measure():
    """[Compiles] from the smallest diagram to the largest. The first round is the first compile of this process, if
    there was none before.
    """
    return [Compiles(lanes, repeats) for lanes, repeats in LANES.items()]


def exponent(smaller, larger):
    """p of a time that grows as blocks to the p."""
    return math.log(larger.compile.least / smaller.compile.least) / math.log(larger.blocks / smaller.blocks)


def n_log_n(smaller, larger):
    """The same of a time that grows as n log n."""
    more, less = (size.blocks * math.log(size.blocks) for size in (larger, smaller))
    return math.log(more / less) / math.log(larger.blocks / smaller.blocks)
