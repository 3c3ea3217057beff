"""Logic. A bool is 0 or 1, any nonzero value is true, and NaN is neither: it passes through every block."""

from __future__ import annotations

import math

from blocks._plumbing.ports import count_param, several
from blocks._plumbing.ranges import can_be_false, can_be_true, hull, truth
from cext.kernels import logic as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class Compare(Block):
    """Comparison of two signals: y = a `relation` b, as in Compare(">")(angle, 0.5).

    Element-wise. Direct feedthrough; NaN passes.
    """

    relation = Param(">", "1", "relation between a and b", choices=("<", "<=", ">", ">=", "==", "!="))

    a = Input("any", "left operand", shape=...)
    b = Input("any", "right operand", shape=...)
    y = Output("1", "true if the relation holds", shape=..., dtype=bool)

    kernel = kernels.relations[">"]

    def configure(self) -> None:
        self.kernel = kernels.relations[self.relation]

    def output_range(self, a: Interval, b: Interval) -> Interval:
        less, more, equal = a.low < b.high, a.high > b.low, a.low <= b.high and b.low <= a.high  # possible relations
        true = {"<": less, "<=": less or equal, ">": more, ">=": more or equal, "==": equal, "!=": less or more}[
            self.relation
        ]
        false = {"<": more or equal, "<=": more, ">": less or equal, ">=": less, "==": less or more, "!=": equal}[
            self.relation
        ]
        return truth(true, false)


class And(Block):
    """Conjunction: y = u1 and u2 and ....

    Element-wise. Direct feedthrough; NaN passes.
    """

    count = count_param()

    y = Output("1", "true if all inputs are true", shape=..., dtype=bool)

    kernel = kernels.conjunction

    def configure(self) -> None:
        self.inputs = several(self.count, "1", bool)

    def output_range(self, **inputs: Interval) -> Interval:
        return truth(all(map(can_be_true, inputs.values())), any(map(can_be_false, inputs.values())))


class Or(Block):
    """Disjunction: y = u1 or u2 or ....

    Element-wise. Direct feedthrough; NaN passes.
    """

    count = count_param()

    y = Output("1", "true if any input is true", shape=..., dtype=bool)

    kernel = kernels.disjunction

    def configure(self) -> None:
        self.inputs = several(self.count, "1", bool)

    def output_range(self, **inputs: Interval) -> Interval:
        return truth(any(map(can_be_true, inputs.values())), all(map(can_be_false, inputs.values())))


class Xor(Block):
    """Exclusive or: y = true if an odd number of inputs are true; for two inputs, if they differ.

    Element-wise. Direct feedthrough; NaN passes.
    """

    count = count_param()

    y = Output("1", "true if an odd number of inputs are true", shape=..., dtype=bool)

    kernel = kernels.parity

    def configure(self) -> None:
        self.inputs = several(self.count, "1", bool)

    def output_range(self, **inputs: Interval) -> Interval:
        if any(can_be_true(u) and can_be_false(u) for u in inputs.values()):
            return truth(True, True)
        odd = sum(map(can_be_true, inputs.values())) % 2 == 1
        return truth(odd, not odd)


class Not(Block):
    """Negation: y = not u.

    Element-wise. Direct feedthrough; NaN passes.
    """

    u = Input("1", "input", shape=..., dtype=bool)
    y = Output("1", "true if the input is false", shape=..., dtype=bool)

    kernel = kernels.negation

    def output_range(self, u: Interval) -> Interval:
        return truth(can_be_false(u), can_be_true(u))


class Edge(Block):
    """Edge detector: true for one tick when the input becomes true (rising), false (falling) or either (both).

    Direct feedthrough. The first sample is not an edge. NaN passes and is not stored: the next sample is compared with
    the one before the NaN.
    """

    kind = Param("rising", "1", "kind of edge", choices=("rising", "falling", "both"))

    u = Input("1", "input", dtype=bool)
    y = Output("1", "true at an edge", dtype=bool)
    previous = Memory(math.nan, "last sample that was not NaN")

    kernel = kernels.edges["rising"]

    def configure(self) -> None:
        self.kernel = kernels.edges[self.kind]

    def output_range(self, u: Interval) -> Interval:
        return truth(can_be_true(u) and can_be_false(u), True)


class Latch(Block):
    """Set-reset latch: true from a true `on` until a true `off`; `off` has priority.

    Direct feedthrough. NaN at either input passes and leaves the state unchanged.
    """

    initial = Param(False, "1", "initial state", fixed=True)

    on = Input("1", "true sets the latch", dtype=bool)
    off = Input("1", "true resets the latch", dtype=bool, default=False)
    y = Output("1", "state of the latch", dtype=bool)
    held = Memory(0.0, "state of the latch")

    kernel = kernels.latch

    def configure(self) -> None:
        self.held = float(self.initial)

    def output_range(self, on: Interval, off: Interval) -> Interval:
        always_off, always_on = not can_be_false(off), not can_be_false(on) and not can_be_true(off)
        return truth(
            not always_off and (self.initial or can_be_true(on)),
            not always_on and (not self.initial or can_be_true(off)),
        )


class Debounce(Block):
    """Debouncer: y follows u once u has kept its new value for `time`.

    Direct feedthrough; with time = 0, y = u. The first sample passes at once. NaN passes and restarts the wait.
    """

    time = Param(0.02, "s", "time for which a new value must be stable", min=0.0)

    u = Input("1", "bouncing input", dtype=bool)
    y = Output("1", "debounced input", dtype=bool)
    held = Memory(math.nan, "debounced value")
    since = Memory(math.nan, "time in s at which the input left this value")

    kernel = kernels.debounce

    def output_range(self, u: Interval) -> Interval:
        return truth(can_be_true(u), can_be_false(u))


class Counter(Block):
    """Counter of rising edges, starting at 0; `clear` resets it and has priority.

    Direct feedthrough. The first sample is not counted. NaN at either input passes, and counting continues after it.
    """

    u = Input("1", "signal whose rising edges are counted", dtype=bool)
    clear = Input("1", "true resets the count to 0", dtype=bool, default=False)
    count = Output("1", "rising edges since the reset", dtype=int, range=(0.0, 2.0**53))
    previous = Memory(math.nan, "last sample that was not NaN")
    total = Memory(0.0, "count")

    kernel = kernels.counter

    def output_range(self, u: Interval, clear: Interval) -> Interval:
        counts = can_be_true(u) and can_be_false(u) and can_be_false(clear)
        return Interval(0.0, 2.0**53) if counts else Interval.point(0.0)


class Timer(Block):
    """Time since `restart` was last true, or since the start: elapsed = t − t₀, 0 while `restart` is true.

    Direct feedthrough. Time follows the clock, even while the subsystem of the timer is disabled. NaN passes without
    stopping the timer.
    """

    restart = Input("1", "true resets the time to 0", dtype=bool, default=False)
    elapsed = Output("s", "time since the last restart", range=(0.0, math.inf))
    since = Memory(math.nan, "start time in s")

    kernel = kernels.timer

    def output_range(self, restart: Interval) -> Interval:
        return Interval(0.0, math.inf if can_be_false(restart) else 0.0)


class Switch(Block):
    """Switch between two signals: y = a if condition else b.

    Direct feedthrough; NaN passes from the selected input and from the condition only.
    """

    condition = Input("1", "true selects a, false selects b", dtype=bool)
    a = Input("any", "output while the condition is true", shape=...)
    b = Input("any", "output while the condition is false", shape=...)
    y = Output("any", "selected input", shape=...)

    kernel = kernels.switch

    def output_range(self, condition: Interval, a: Interval, b: Interval) -> Interval:
        if not can_be_false(condition):
            return a
        return a | b if can_be_true(condition) else b


class Selector(Block):
    """Selection of one of several signals: y = u[index], with the index starting at 0.

    Direct feedthrough. The index is rounded down. An index out of range gives NaN, which is a fault at an actuator. NaN
    passes from the selected input and from the index only.
    """

    count = count_param()

    index = Input("1", "number of the selected input, from 0", dtype=int)
    y = Output("any", "selected input", shape=...)

    kernel = kernels.select

    def configure(self) -> None:
        signals = {f"u{i}": Input("any", f"output for index {i}", shape=...).named(f"u{i}") for i in range(self.count)}
        self.inputs = {"index": type(self).index} | signals

    def output_range(self, index: Interval, **inputs: Interval) -> Interval:
        reachable = [u for i, u in enumerate(inputs.values()) if index.low < i + 1 and i <= index.high] or list(
            inputs.values()
        )
        return hull(reachable)
