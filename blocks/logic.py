"""Logic. A bool is 0 or 1 in a wire, anything but 0 is true, and NaN is neither: it passes through every one of
these.
"""

import math

from blocks._plumbing.ports import several
from blocks._plumbing.ranges import can_be_false, can_be_true, hull, truth
from cext.kernels import logic as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class Compare(Block):
    """Compares two signals: y = a `relation` b, as in Compare(">")(angle, 0.5). Direct feedthrough; element by
    element.
    """

    relation = Param(">", "1", "between a and b", choices=("<", "<=", ">", ">=", "==", "!="))

    a = Input("any", "left side", shape=...)
    b = Input("any", "right side", shape=...)
    y = Output("1", "whether it holds", shape=..., dtype=bool)

    kernel = kernels.relations[">"]

    def configure(self):
        self.kernel = kernels.relations[self.relation]

    def output_range(self, a, b):
        less, more, equal = a.low < b.high, a.high > b.low, a.low <= b.high and b.low <= a.high  # what can be
        true = {"<": less, "<=": less or equal, ">": more, ">=": more or equal, "==": equal, "!=": less or more}[
            self.relation
        ]
        false = {"<": more or equal, "<=": more, ">": less or equal, ">=": less, "==": less or more, "!=": equal}[
            self.relation
        ]
        return truth(true, false)


class And(Block):
    """Whether all of several signals are true. Direct feedthrough; element by element."""

    count = Param(2, "1", "how many inputs", min=2, fixed=True)

    y = Output("1", "whether all are true", shape=..., dtype=bool)

    kernel = kernels.conjunction

    def configure(self):
        self.inputs = several(self.count, "1", bool)

    def output_range(self, **inputs):
        return truth(all(map(can_be_true, inputs.values())), any(map(can_be_false, inputs.values())))


class Or(Block):
    """Whether one of several signals is true. Direct feedthrough; element by element."""

    count = Param(2, "1", "how many inputs", min=2, fixed=True)

    y = Output("1", "whether one is true", shape=..., dtype=bool)

    kernel = kernels.disjunction

    def configure(self):
        self.inputs = several(self.count, "1", bool)

    def output_range(self, **inputs):
        return truth(any(map(can_be_true, inputs.values())), all(map(can_be_false, inputs.values())))


class Xor(Block):
    """Whether an odd number of signals are true: of two, whether they differ. Direct feedthrough; element by
    element.
    """

    count = Param(2, "1", "how many inputs", min=2, fixed=True)

    y = Output("1", "whether an odd number is true", shape=..., dtype=bool)

    kernel = kernels.parity

    def configure(self):
        self.inputs = several(self.count, "1", bool)

    def output_range(self, **inputs):
        if any(can_be_true(u) and can_be_false(u) for u in inputs.values()):
            return truth(True, True)
        odd = sum(map(can_be_true, inputs.values())) % 2 == 1
        return truth(odd, not odd)


class Not(Block):
    """Whether a signal is false. Direct feedthrough; element by element."""

    u = Input("1", "input", shape=..., dtype=bool)
    y = Output("1", "whether it is false", shape=..., dtype=bool)

    kernel = kernels.negation

    def output_range(self, u):
        return truth(can_be_false(u), can_be_true(u))


class Edge(Block):
    """Whether a signal has just become true (rising), false (falling), or either (both): true for one tick.

    Direct feedthrough. The first sample is no edge. A NaN passes and is not remembered: the sample after it is held
    against the one before.
    """

    kind = Param("rising", "1", "which edge", choices=("rising", "falling", "both"))

    u = Input("1", "input", dtype=bool)
    y = Output("1", "whether it is the edge", dtype=bool)
    previous = Memory(math.nan, "last sample that was not NaN")

    kernel = kernels.edges["rising"]

    def configure(self):
        self.kernel = kernels.edges[self.kind]

    def output_range(self, u):
        return truth(can_be_true(u) and can_be_false(u), True)


class Latch(Block):
    """Remembers: true from when `on` is true until `off` is; off wins. (The set-reset latch.)

    Direct feedthrough. A NaN at either input passes, and what is remembered stays as it was.
    """

    initial = Param(False, "1", "what it remembers at the start", fixed=True)

    on = Input("1", "sets it", dtype=bool)
    off = Input("1", "resets it", dtype=bool, default=False)
    y = Output("1", "what it remembers", dtype=bool)
    held = Memory(0.0, "what it remembers")

    kernel = kernels.latch

    def configure(self):
        self.held = float(self.initial)

    def output_range(self, on, off):
        always_off, always_on = not can_be_false(off), not can_be_false(on) and not can_be_true(off)
        return truth(
            not always_off and (self.initial or can_be_true(on)),
            not always_on and (not self.initial or can_be_true(off)),
        )


class Debounce(Block):
    """Follows a signal once it has kept its new value for `time`: what is shorter never shows.

    Direct feedthrough; with time = 0 it is the input. The first sample is believed at once. A NaN passes, and the wait
    begins anew.
    """

    time = Param(0.02, "s", "how long a new value must last", min=0.0)

    u = Input("1", "input that bounces", dtype=bool)
    y = Output("1", "input that has settled", dtype=bool)
    held = Memory(math.nan, "what has settled")
    since = Memory(math.nan, "s, when the input left it")

    kernel = kernels.debounce

    def output_range(self, u):
        return truth(can_be_true(u), can_be_false(u))


class Counter(Block):
    """Counts how often a signal becomes true, from 0; `clear` sets it to 0 and wins.

    Direct feedthrough. The first sample is not counted. A NaN at either input passes, and the count goes on after it.
    """

    u = Input("1", "what is counted", dtype=bool)
    clear = Input("1", "sets the count to 0", dtype=bool, default=False)
    count = Output("1", "rising edges since then", dtype=int, range=(0.0, 2.0**53))
    previous = Memory(math.nan, "last sample that was not NaN")
    total = Memory(0.0, "the count")

    kernel = kernels.counter

    def output_range(self, u, clear):
        counts = can_be_true(u) and can_be_false(u) and can_be_false(clear)
        return Interval(0.0, 2.0**53) if counts else Interval.point(0.0)


class Timer(Block):
    """Time since `restart` was last true, or since the start: y = t − t₀, 0 while it is true.

    Direct feedthrough. Time passes by the clock, also while a subsystem that holds the timer is disabled. A NaN passes,
    and time goes on.
    """

    restart = Input("1", "begins anew", dtype=bool, default=False)
    elapsed = Output("s", "time since then", range=(0.0, math.inf))
    since = Memory(math.nan, "s, when it began")

    kernel = kernels.timer

    def output_range(self, restart):
        return Interval(0.0, math.inf if can_be_false(restart) else 0.0)


class Switch(Block):
    """Chooses between two signals: y = a if condition else b.

    Direct feedthrough; a NaN shows only from the one that is chosen, or from the condition.
    """

    condition = Input("1", "which one", dtype=bool)
    a = Input("any", "chosen while the condition is true", shape=...)
    b = Input("any", "chosen while it is false", shape=...)
    y = Output("any", "the chosen one", shape=...)

    kernel = kernels.switch

    def output_range(self, condition, a, b):
        if not can_be_false(condition):
            return a
        return a | b if can_be_true(condition) else b


class Selector(Block):
    """Chooses one of several signals by number: y = u[index], counted from 0; NaN, a fault at an actuator, where there
    is no such input.

    Direct feedthrough; an index between two whole numbers chooses the lower. A NaN shows only from the chosen one, or
    from the index.
    """

    count = Param(2, "1", "how many inputs", min=2, fixed=True)

    index = Input("1", "which one, from 0", dtype=int)
    y = Output("any", "the chosen one", shape=...)

    kernel = kernels.select

    def configure(self):
        signals = {f"u{i}": Input("any", f"chosen by {i}", shape=...).named(f"u{i}") for i in range(self.count)}
        self.inputs = {"index": type(self).index} | signals

    def output_range(self, index, **inputs):
        reachable = [u for i, u in enumerate(inputs.values()) if index.low < i + 1 and i <= index.high] or list(
            inputs.values()
        )
        return hull(reachable)
