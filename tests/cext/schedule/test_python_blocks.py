"""Python blocks in the tick: what a step is given, what it may return, and what becomes of everything else."""

import collections
import math
import sys
from fractions import Fraction

import numpy as np
import pytest

from blocks.discrete import UnitDelay
from blocks.mathematics import Gain
from blocks.sources import Sine
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, Param, compile
from tests.cext.rigs import Rig
from tests.graph.test_style_samples import PeakHold


def run(diagram, ticks=20):
    rig = Rig(diagram)
    return rig.run(ticks), rig


class Source(Block):
    """Outputs a list tick by tick, then its last value."""

    y = Output("any")

    def __init__(self, values, **options):
        self.values = values
        super().__init__(**options)

    def step(self, tick):
        return self.values[min(tick, len(self.values) - 1)]


class Returns(Block):
    """Gives one thing at tick 5, and 0.0 at every other."""

    y = Output("1")

    def __init__(self, value, **options):
        self.value = value
        super().__init__(**options)

    def step(self, tick):
        return self.value if tick == 5 else 0.0


def test_step_receives_clock_and_inputs_in_signature_order():
    seen = []

    class Asks(Block):
        """Asks for everything, in an order of its own."""

        a = Input("any")
        b = Input("any")
        y = Output("any")

        def step(self, dt, b, tick, a, t):
            seen.append((dt, b, tick, a, t))
            return 10.0 * a + b

    with Diagram("d", rate=50) as diagram:
        Asks(name="asks")(a=1.0, b=Source([2.0, 3.0], name="source").y)
    _, rig = run(diagram, 3)
    assert seen == [(0.02, 2.0, 0, 1.0, 0.0), (0.02, 3.0, 1, 1.0, 0.02), (0.02, 3.0, 2, 1.0, 0.04)]
    assert [type(value) for value in seen[0]] == [float, float, int, float, float]
    assert rig["asks.y"].tolist() == [12.0, 13.0, 13.0]


def test_floats_bools_and_ints_keep_their_types():
    seen = []

    class Types(Block):
        """One of each."""

        number = Input("1")
        count = Input("1", dtype=int)
        truth = Input("1", dtype=bool)
        a = Output("1")
        b = Output("1", dtype=int)
        c = Output("1", dtype=bool)

        def step(self, number, count, truth):
            seen.append((number, count, truth))
            return number / 2, count * 10, not truth

    with Diagram("d", rate=50) as diagram:
        first = Types(name="first")(0.5, 3, True)
        Types(name="second")(first.a, first.b, first.c)
    _, rig = run(diagram, 1)
    assert seen == [(0.5, 3, True), (0.25, 30, False)]
    assert [[type(value) for value in values] for values in seen] == [[float, int, bool]] * 2
    assert [rig[f"second.{port}"][0] for port in "abc"] == [0.125, 300.0, 1.0]


def test_a_whole_number_keeps_all_its_digits_up_to_two_to_the_53():
    class Counts(Block):
        """Passes a whole number."""

        n = Input("1", dtype=int)
        m = Output("1", dtype=int)

        def step(self, n):
            return n - 1

    with Diagram("d", rate=50) as diagram:
        Counts(name="c")(2**53)
    _, rig = run(diagram, 1)
    assert rig["c.m"][0] == 2**53 - 1


def test_input_vectors_are_persistent_read_only_views():
    seen = []

    class Vector(Block):
        """Works on a matrix."""

        u = Input("any", shape=(2, 2))
        y = Output("any", shape=(2, 2))
        trace = Output("any")

        def step(self, u):
            seen.append(u)
            return u.T, np.trace(u)

    with Diagram("d", rate=50) as diagram:
        Vector(name="v")([[1.0, 2.0], [3.0, 4.0]])
    _, rig = run(diagram, 3)
    assert seen[0] is seen[2] and not seen[0].flags.writeable and seen[0].shape == (2, 2)
    assert [rig[f"v.y[{i}][{k}]"][0] for i in (0, 1) for k in (0, 1)] == [1.0, 3.0, 2.0, 4.0] and rig["v.trace"][
        0
    ] == 5.0


def test_writing_to_an_input_is_an_error_of_that_block():
    class Writes(Block):
        """Would change what others read."""

        u = Input("any", shape=(2,))
        y = Output("any")

        def step(self, u):
            u[0] = 1.0
            return 0.0

    with Diagram("d", rate=50) as diagram:
        Writes(name="w")([0.0, 0.0])
    outcome, _ = run(diagram)
    assert outcome.culprit == "w" and isinstance(outcome.error, ValueError) and outcome.tick == 0


def test_an_output_vector_may_be_a_list_or_the_input_itself():
    class Passes(Block):
        """Gives back what it was given."""

        u = Input("any", shape=...)
        y = Output("any", shape=...)

        def step(self, u):
            return u

    class Lists(Block):
        """A list."""

        y = Output("any", shape=(3,))

        def step(self, t):
            return [t, 1, True]

    with Diagram("d", rate=50) as diagram:
        Passes(name="p")(Lists().y)
    _, rig = run(diagram, 3)
    assert rig["p.y[0]"].tolist() == [0.0, 0.02, 0.04] and rig["p.y[1]"][0] == rig["p.y[2]"][0] == 1.0


def test_an_output_vector_may_be_an_array_of_any_layout_and_type():
    matrix = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    frozen = matrix.copy()
    frozen.flags.writeable = False
    forms = [
        matrix,
        frozen,
        np.asfortranarray(matrix),
        np.repeat(matrix, 2, axis=1)[:, ::2],
        matrix[::-1, ::-1][::-1, ::-1],
        matrix.astype(">f8"),
        matrix.astype(np.float32),
        matrix.astype(int),
        np.ma.array(matrix),
        matrix.tolist(),
    ]

    class Forms(Block):
        """Returns one form in each tick."""

        y = Output("any", shape=(2, 3))

        def step(self, tick):
            return forms[tick]

    with Diagram("d", rate=50) as diagram:
        Forms(name="f")
    _, rig = run(diagram, len(forms))
    for row in range(2):
        for column in range(3):
            assert rig[f"f.y[{row}][{column}]"].tolist() == [matrix[row, column]] * len(forms)


@pytest.mark.parametrize(
    "value, stored",
    [
        (3, 3.0),
        (True, 1.0),
        (np.float32(0.5), 0.5),
        (np.int16(-2), -2.0),
        (Fraction(1, 4), 0.25),
        (np.array(1.5), 1.5),
        (-0.0, 0.0),
        (1e308, 1e308),
        (math.inf, math.inf),
        (-math.inf, -math.inf),
    ],
)
def test_numeric_types_are_stored_as_numbers(value, stored):
    with Diagram("d", rate=50) as diagram:
        Returns(value, name="r")
    outcome, rig = run(diagram)
    assert outcome.status == "ok" and rig["r.y"][5] == stored


def test_a_nan_result_is_recorded_and_other_blocks_continue():
    with Diagram("d", rate=50) as diagram:
        value = Returns(math.nan, name="r").y
        PeakHold(name="peak")(value)
        Gain(2.0, name="g")(value)
    outcome, rig = run(diagram)
    assert outcome.status == "ok" and [tick for tick in range(20) if math.isnan(rig["g.y"][tick])] == [5]
    assert math.isnan(rig["peak.y"][5]) and rig["peak.y"][6] == 0.0


@pytest.mark.parametrize(
    "value", [None, "1.0", [1.0], (1.0, 2.0), np.array([1.0, 2.0]), 1j, {"y": 1.0}, object(), lambda: 1.0]
)
def test_non_numeric_output_is_reported_with_block_and_port(value):
    with Diagram("d", rate=50) as diagram:
        Returns(value, name="odd")
    outcome, rig = run(diagram)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "odd", 5) and isinstance(
        outcome.error, TypeError
    )
    where = "one output, y: return one value" if isinstance(value, tuple) else " for y: "
    assert str(outcome.error).startswith("odd.step returned ") and where in str(outcome.error)


def test_the_representation_of_a_value_is_formed_only_when_the_text_is_read():
    shown = []

    class Slow:
        def __repr__(self):
            shown.append(self)
            return "slow"

    with Diagram("d", rate=50) as diagram:
        Returns(Slow(), name="odd")
    outcome, _ = run(diagram)
    assert outcome.status == "exception" and not shown
    assert str(outcome.error).startswith("odd.step returned slow for y: ")


def test_a_number_too_large_for_a_double_is_an_error_too():
    with Diagram("d", rate=50) as diagram:
        Returns(10**400, name="huge")
    outcome, _ = run(diagram)
    assert (outcome.status, outcome.culprit) == ("exception", "huge") and isinstance(outcome.error, OverflowError)


@pytest.mark.parametrize(
    "dtype, value, fine",
    [
        (int, 3, True),
        (int, np.int32(3), True),
        (int, True, True),
        (int, 3.0, False),
        (int, "3", False),
        (int, None, False),
        (bool, True, True),
        (bool, np.bool_(False), True),
        (bool, 1, True),
        (bool, 0.0, True),
        (bool, math.nan, False),
        (bool, None, False),
        (bool, "no", False),
        (bool, [], False),
    ],
)
def test_bool_and_int_outputs_are_type_checked(dtype, value, fine):
    class Typed(Block):
        """One output of one type."""

        y = Output("1", dtype=dtype)

        def step(self):
            return value

    with Diagram("d", rate=50) as diagram:
        Typed(name="typed")
    outcome, rig = run(diagram)
    assert (outcome.status == "ok") is fine
    if fine:
        assert rig["typed.y"][0] == float(value)
    else:
        assert outcome.culprit == "typed" and isinstance(outcome.error, TypeError)


Pair = collections.namedtuple("Pair", "a b")


@pytest.mark.parametrize(
    "result, fine",
    [
        ((1.0, 2.0), True),
        ([1.0, 2.0], True),
        (Pair(1.0, 2.0), True),
        ((1, True), True),
        ((1.0,), False),
        ((1.0, 2.0, 3.0), False),
        (1.0, False),
        (None, False),
        ({"a": 1.0, "b": 2.0}, False),
        (np.array([1.0, 2.0]), False),
        ((1.0, None), False),
        ((1.0, "2"), False),
        ("ab", False),
    ],
)
def test_several_outputs_are_a_tuple_or_list_of_that_length(result, fine):
    class Two(Block):
        """Two outputs."""

        a = Output("1")
        b = Output("1")

        def step(self):
            return result

    with Diagram("d", rate=50) as diagram:
        Two(name="two")
    outcome, rig = run(diagram, 2)
    assert (outcome.status == "ok") is fine
    if fine:
        assert (rig["two.a"][0], rig["two.b"][0]) == tuple(float(value) for value in result)
    else:
        assert isinstance(outcome.error, TypeError) and "two.step " in str(outcome.error)


@pytest.mark.parametrize("result", [[1.0, 2.0], [[1.0, 2.0, 3.0]], 1.0, None, ["a", "b", "c"]])
def test_vector_of_wrong_shape_is_reported(result):
    class Three(Block):
        """Three numbers."""

        y = Output("1", shape=(3,))

        def step(self):
            return result

    with Diagram("d", rate=50) as diagram:
        Three(name="three")
    outcome, _ = run(diagram, 2)
    assert (
        outcome.culprit == "three"
        and isinstance(outcome.error, TypeError)
        and "three.step returned" in str(outcome.error)
    )


@pytest.mark.parametrize("dtype", [int, bool])
def test_nan_in_int_or_bool_is_a_fault_of_the_reading_block(dtype):
    class Reads(Block):
        """Reads what NaN is not."""

        n = Input("any", dtype=dtype)
        y = Output("1")

        def step(self, n):
            return float(n)

    with Diagram("d", rate=50) as diagram:
        Reads(name="reads")(Source([0.0, 1.0, math.nan], name="s").y)
    outcome, _ = run(diagram)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "reads", 2)
    assert str(outcome.error) == "reads.n is nan, which is neither an int nor a bool"


def test_the_attributes_of_a_python_block_have_a_dict_that_the_interpreter_reads_fast():
    class Scales(Block):
        """Reads a parameter."""

        factor = Param(2.0, "1")
        y = Output("1")

        def step(self):
            return self.factor

    with Diagram("d", rate=10) as diagram:
        block = Scales()
    run(diagram, 3)
    assert sys.getsizeof(vars(block)) >= sys.getsizeof(dict(vars(block))), "its keys are those of all instances"


def test_update_follows_all_steps_and_uses_inputs_of_its_tick():
    class Integrator(Block):
        """y[k + 1] = y[k] + dt u[k]."""

        u = Input("any")
        y = Output("any")

        def reset(self):
            self.total = 0.0

        def step(self):
            return self.total

        def update(self, u, dt):
            self.total += dt * u

    with Diagram("d", rate=10) as diagram:
        integrator = Integrator(name="i")
        integrator(Gain(-1.0, name="g")(integrator.y))
        Integrator(name="ramp")(1.0)
        Integrator(name="twice")(diagram["ramp"].y)
    _, rig = run(diagram, 5)
    assert rig["ramp.y"].tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert rig["twice.y"].tolist() == pytest.approx([0.0, 0.0, 0.01, 0.03, 0.06])
    assert rig["i.y"].tolist() == [0.0] * 5


def test_reset_comes_before_every_run():
    class Counts(Block):
        """Counts."""

        y = Output("1")

        def reset(self):
            self.count = 0

        def step(self):
            self.count += 1
            return self.count

    with Diagram("d", rate=10) as diagram:
        Counts(name="c")
    rig = Rig(diagram)
    for _ in range(3):
        rig.run(4)
        assert rig["c.y"].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_a_block_with_any_number_of_inputs_receives_all_of_them():
    class Most(Block):
        """The largest."""

        a = Input("any")
        b = Input("any")
        c = Input("any", default=-1.0)
        y = Output("any")

        def step(self, *inputs):
            assert len(inputs) == 3
            return max(inputs)

    with Diagram("d", rate=10) as diagram:
        Most(name="m")(Source([1.0, 5.0, 2.0], name="s").y, 3.0)
    _, rig = run(diagram, 3)
    assert rig["m.y"].tolist() == [3.0, 5.0, 3.0]


def test_the_return_value_of_a_block_without_outputs_is_ignored():
    seen = []

    class Notes(Block):
        """Only looks."""

        u = Input("any")

        def step(self, u):
            return seen.append(u) or "whatever"

    with Diagram("d", rate=10) as diagram:
        Notes()(Source([1.0, 2.0], name="s").y)
    outcome, _ = run(diagram, 2)
    assert outcome.status == "ok" and seen == [1.0, 2.0]


def test_more_than_32_inputs_are_refused():
    ports = {f"u{i}": Input("1", default=0.0) for i in range(33)}
    Wide = type(
        "Wide", (Block,), {"__doc__": "Many inputs.", **ports, "y": Output("1"), "step": lambda self, *inputs: 0.0}
    )
    with Diagram("d", rate=10) as diagram:
        Wide(name="wide")
    with pytest.raises(ValueError, match="wide: a Python block has at most 32 inputs and 32 outputs"):
        Program(compile(diagram))


def test_native_and_python_blocks_of_one_law_agree_bit_for_bit():
    class Python(Block):
        """Its kernel, in Python."""

        gain = Param(0.3, "any")
        u = Input("any")
        y = Output("any")

        def step(self, u):
            return self.gain * u

    with Diagram("d", rate=97) as diagram:
        wave = Sine(frequency=1.7, name="s").y
        UnitDelay(name="a")(Gain(0.3, name="native")(wave))
        UnitDelay(name="b")(Python(0.3, name="python")(wave))
    _, rig = run(diagram, 500)
    assert rig["native.y"].tobytes() == rig["python.y"].tobytes() and rig["a.y"].tobytes() == rig["b.y"].tobytes()


def test_a_python_block_that_leaves_the_range_it_declares_is_stopped_there():
    class Promises(Returns):
        """Promises a range."""

        y = Output("1", range=(-1.0, 1.0))

    for value, fine in (
        (1.0, True),
        (1.0000000001, False),
        (-1, True),
        (-2, False),
        (math.inf, False),
        (math.nan, True),
    ):
        with Diagram("d", rate=10) as diagram:
            Promises(value, name="p")
        outcome, _ = run(diagram, 10)
        assert (outcome.status == "ok") is fine
        if not fine:
            assert outcome.culprit == "p" and "outside its declared range [-1, 1]" in str(outcome.error)


@pytest.mark.parametrize("form", [list, tuple, np.array])
def test_a_vector_outside_its_range_is_refused_in_every_form(form):
    class Limited(Block):
        """Leaves its range at tick 5."""

        y = Output("1", shape=(3,), range=(-1.0, 1.0))

        def step(self, tick):
            return form([0.5, -0.25, tick / 4.0])

    with Diagram("d", rate=10) as diagram:
        Limited(name="limited")
    outcome, rig = run(diagram, 10)
    assert (outcome.culprit, outcome.tick) == ("limited", 5)
    assert str(outcome.error) == "limited.y is array([ 0.5 , -0.25,  1.25]), outside its declared range [-1, 1]"
    assert [rig[f"limited.y[{i}]"][4] for i in range(3)] == [0.5, -0.25, 1.0]


class Pair(Block):
    """An array of two, and its sum."""

    u = Input("any")
    both = Output("1", shape=(2,))
    total = Output("1")

    def step(self, u):
        return [1.0, u], 1.0 + u


def test_steps_in_which_an_output_is_nan_are_counted_in_each_run():
    with Diagram("nan", rate=100) as diagram:
        Pair(name="pair")(Source([1.0, math.nan, 2.0, math.nan, 3.0], name="source")())
    outcome, rig = run(diagram)
    assert outcome.status == "ok"
    assert rig.control.nan == [("source.y", 2, 20), ("pair.both", 2, 20), ("pair.total", 2, 20)]
    rig.run(3)
    assert rig.control.nan == [("source.y", 1, 3), ("pair.both", 1, 3), ("pair.total", 1, 3)]
