"""The conformance test finds each kind of broken block. (That every block of the library passes it: tests/blocks.)"""

import math

import numpy as np
import pytest

from cext.kernels import discrete as kernels
from graph import Block, Input, Interval, Memory, Output, Param, Sink
from graph.conformance import check_block


class Sound(Block):
    """y = 2 u."""

    gain = Param(2.0, "1", "factor", min=0.0, max=3.0)
    u = Input("1", "in")
    y = Output("1", "out")

    def step(self, u):
        return self.gain * u


def test_a_correct_block_passes_the_conformance_test():
    assert check_block(Sound) == 10


def test_the_conformance_test_sets_the_width_before_output_range():
    class Total(Block):
        """The sum of a vector."""

        u = Input("1", "in", shape=...)
        y = Output("1", "out")

        def output_range(self, u):
            return Interval(2.0 * self.width * u.low, 2.0 * self.width * u.high)

        def step(self, u):
            return float(np.sum(u))

    assert check_block(Total) == 10


class NoUnitSaid(Sound):
    """A port without a description."""

    y = Output("1")


class Shapeless(Sound):
    """Returns two numbers where one is declared."""

    def step(self, u):
        return u, u


class Forgetful(Sound):
    """Keeps its state across a reset."""

    total = 0.0

    def step(self, u):
        self.total += u
        return self.total


class NanHider(Sound):
    """Turns NaN into zero."""

    def step(self, u):
        return 0.0 if math.isnan(u) else u


class NanKeeper(Sound):
    """Keeps a NaN beyond the reset."""

    worst = 0.0

    def step(self, u):
        if u != u:
            self.worst = u
        return u + self.worst


class Liar(Sound):
    """Leaves the range it states."""

    y = Output("1", "out", range=(-1.0, 1.0))


class Unbounded(Sound):
    """Takes any gain."""

    gain = Param(2.0, "1", "factor", min=0.0, max=3.0)

    def __init__(self, gain=2.0, **named):
        super().__init__(gain=min(max(gain, 0.0), 3.0) if gain == gain else 1.0, **named)


class Deaf(Sound):
    """Reads its gain before the run."""

    def configure(self):
        self.factor = self.gain

    def step(self, u):
        return self.factor * u


class NativelyDeaf(Block):
    """A delay whose kernel never looks at `initial`: its memory holds it from the start."""

    initial = Param(2.0, "1", "first output", min=0.0, max=9.0)
    u = Input("1", "in")
    y = Output("1", "out")
    held = Memory(0.0, "the input of the tick before")

    kernel = kernels.unit_delay
    update_kernel = kernels.unit_delay_next
    feedthrough = ()

    def prepare(self, dt):
        self.held = [self.initial]


class Wide(Sound):
    """Its number of inputs is a parameter."""

    count = Param(2, "1", "how many", min=1, max=4)

    def configure(self):
        self.inputs = {f"u{i}": Input("1", "in").named(f"u{i}") for i in range(self.count)}

    def step(self, *inputs):
        return sum(inputs)


@pytest.mark.parametrize("kind, parameter", [(Deaf, "gain"), (NativelyDeaf, "initial"), (Wide, "count")])
def test_a_parameter_that_has_no_effect_while_running_must_be_declared_fixed(kind, parameter):
    with pytest.raises(
        AssertionError, match=f"{kind.__name__}.{parameter} has no effect while running: after a change from 2"
    ) as caught:
        check_block(kind)
    assert "declare it fixed=True" in str(caught.value)
    param = kind.parameters[parameter]
    body = {
        "__doc__": kind.__doc__,
        parameter: Param(param.default, param.unit, param.description, min=param.min, max=param.max, fixed=True),
    }
    assert check_block(type("Mended", (kind,), body)) == 10


def test_a_parameter_that_reset_reads_has_its_effect_at_the_next_reset():
    class Counter(Sound):
        """Counts from a start."""

        start = Param(1, "1", "first value", min=0, max=9)

        def reset(self):
            self.count = self.start

        def step(self, u):
            self.count += 1
            return self.count + self.gain * u

    assert check_block(Counter) == 10


def test_parameters_of_devices_and_sinks_are_fixed():
    class Printer(Sink):
        """Prints."""

        columns = Param(80, "1", "how many", min=1, max=200)

    with pytest.raises(AssertionError, match="Printer.columns is read before the run"):
        check_block(Printer)


@pytest.mark.parametrize(
    "kind, said",
    [
        (NoUnitSaid, "NoUnitSaid.y has no description"),
        (Shapeless, "Shapeless.y has shape"),
        (Forgetful, "differs after reset"),
        (NanHider, "NanHider hides a NaN"),
        (NanKeeper, "differs after reset"),
        (Liar, "outside its stated range"),
        (Unbounded, "Unbounded accepts gain=-1.0"),
    ],
)
def test_each_kind_of_broken_block_is_found(kind, said):
    with pytest.raises(AssertionError, match=said):
        check_block(kind)


class Clipper(Sound):
    """Clips in Python, which turns an infinity into a bound."""

    def step(self, u):
        return min(max(self.gain * u, -1.0), 1.0)

    def output_range(self, u):
        return Interval(-1.0, 1.0)


def test_a_block_that_clips_an_infinity_fails_the_check():
    with pytest.raises(AssertionError, match="Clipper hides an infinity: its outputs are {'y': 1.0}"):
        check_block(Clipper)


class Crossing(Sound):
    """Relates two parameters in `configure`."""

    lower = Param(-1.0, "1", "lower end")
    upper = Param(1.0, "1", "upper end")

    def configure(self):
        if self.lower > self.upper:
            raise ValueError("crossed")

    def step(self, u):
        return min(max(self.gain * u, self.lower), self.upper) + (u - u)


def test_a_rule_between_parameters_must_be_declared():
    with pytest.raises(AssertionError, match=r"Crossing rejects .*lower=3 \(crossed\), which a live change"):
        check_block(Crossing)
    assert check_block(type("Mended", (Crossing,), {"__doc__": "Declares it.", "rules": ("lower <= upper",)})) == 10
    fixed = {"__doc__": "Reads one end before the run.", "lower": Param(-1.0, "1", "lower end", fixed=True)}
    with pytest.raises(AssertionError, match="Fixed rejects .*upper=-"):
        check_block(type("Fixed", (Crossing,), fixed))
