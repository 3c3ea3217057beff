"""Blocks: declarations, parameters, what a step may look like, and what is refused with the user's own line."""

import functools
import math
import re

import numpy as np
import pytest

import runtime
from blocks.controllers import Impedance
from blocks.filters import Butterworth
from blocks.limiters import Saturation, TorqueLimiter
from blocks.mathematics import Gain, Sum
from graph import Block, Diagram, DiagramError, Input, Memory, Output, Param, deg
from graph.block import _WORDS
from graph.names import snake_case
from tests.checkout import ROOT
from tests.graph.complaints import complaints, here, refusal


class Everything(Block):
    """A block with one parameter of each kind."""

    number = Param(1.0, "N·m", "a torque", min=-2.0, max=2.0)
    positive = Param(1.0, "s", "a time", above=0.0, below=10.0)
    count = Param(3, "1", "how many", min=1)
    flag = Param(False, "1", "whether")
    text = Param("a", "1", "one of two", choices=("a", "b"))
    optional = Param(None, "rad", "an angle, if any", dtype=float)
    needed = Param(1.0, "1", "no default for this one", required=True)

    u = Input("1")
    y = Output("1")

    def step(self, u):
        return u


def test_a_parameter_is_an_attribute_of_the_block_only():
    class Doubled(Everything):
        number = Param(2.0, "N·m", "a torque")

    assert not hasattr(Everything, "number") and not hasattr(Doubled, "number")
    assert list(Doubled.parameters) == list(Everything.parameters)
    assert (Everything(needed=0.0).number, Doubled(needed=0.0).number) == (1.0, 2.0)


def test_a_parameter_is_a_plain_attribute_in_its_declared_type():
    block = Everything(needed=2, number=np.float64(1), count=4.0, flag=np.bool_(True))
    assert (block.number, block.count, block.flag, block.needed) == (1.0, 4, True, 2.0)
    assert [type(v) for v in (block.number, block.count, block.flag, block.needed)] == [float, int, bool, float]
    assert block.optional is None and Everything(needed=1, optional=2).optional == 2.0
    assert "number" in vars(block)  # no data descriptor: a step reads it at full speed


@pytest.mark.parametrize(
    "given, complaint",
    [
        ({"number": 3.0}, "number: must be at most 2.0 N·m, got 3.0"),
        ({"number": -2.5}, "number: must be at least -2.0 N·m, got -2.5"),
        ({"positive": 0}, "positive: must be above 0.0 s, got 0.0"),
        ({"positive": 10.0}, "positive: must be below 10.0 s, got 10.0"),
        ({"number": math.nan}, "number: NaN is not allowed"),
        ({"number": "1"}, "number: expected a number, got '1'"),
        ({"number": b"1"}, "number: expected a number, got b'1'"),
        ({"number": 1j}, "number: expected a number, got 1j"),
        ({"number": {"a": 1}}, "number: expected a number, got {'a': 1}"),
        ({"number": [1.0, 2.0]}, "number: expected one number, got [1.0, 2.0]"),
        ({"number": None}, "number: expected a value, got None"),
        ({"number": 1j}, "number: "),
        ({"count": 2.5}, "count: expected a whole number, got 2.5"),
        ({"count": math.inf}, "count: expected a whole number, got inf"),
        ({"count": math.nan}, "count: expected a whole number, got nan"),
        ({"count": True}, "count: expected a whole number, got True"),
        ({"count": 0}, "count: must be at least 1, got 0"),
        ({"count": 10**400}, "count: "),
        ({"flag": 1}, "flag: expected True or False, got 1"),
        ({"text": "c"}, "text: must be one of a, b, got 'c'"),
        ({"text": 1}, "text: expected text, got 1"),
        ({"needed": None}, "needed: expected a value, got None"),
    ],
)
def test_a_wrong_parameter_is_reported_with_its_bound_and_the_users_line(given, complaint):
    found = refusal(Everything, **{"needed": 1.0} | given)
    assert found.code == "TW010" and found.path == "Everything" and found.message.startswith(complaint)
    # `refusal` made the block: the nearest line outside the language
    assert found.where.file == refusal.__code__.co_filename


def test_all_wrong_parameters_are_reported_at_once_where_the_block_was_made():
    with pytest.raises(DiagramError) as caught:
        at = here(1)
        Everything(5.0, flag=3, cuont=1)
    found = caught.value.diagnostics
    assert [d.message for d in found] == [
        "has no parameter 'cuont'",
        "number: must be at most 2.0 N·m, got 5.0",
        "flag: expected True or False, got 3",
        "needed is missing",
    ]
    assert (
        {d.where for d in found} == {at}
        and found[0].hint == "did you mean 'count'?"
        and found[3].hint == "no default for this one"
    )


def test_parameters_by_position_are_counted_and_not_given_twice():
    assert refusal(Gain, 1.0, "1", 3.0).message == "takes 2 parameters (gain, unit), got 3"
    assert refusal(Gain, 1.0, gain=2.0).message == "gain was given twice"


def test_only_some_parameters_of_a_block_may_be_passed_by_position():
    class Drive(Block):
        y = Output("1")
        speed = Param(1.0)
        bus = Param("can", dtype=str)
        positional = ("bus",)

        def step(self):
            return self.speed

    assert list(Drive.parameters) == ["bus", "speed"]
    assert Drive("legs", speed=2.0).step() == 2.0
    found = refusal(Drive, "legs", 2.0)
    assert (found.message, found.hint) == ("takes 1 parameter by position (bus), got 2", "pass the others by name")
    with pytest.raises(TypeError, match="Wrong.positional names 'buss', which is not a parameter of the class"):
        type("Wrong", (Drive,), {"positional": ("buss",)})


@pytest.mark.parametrize("every", [0, -1, 1.5, "2", None, True, math.nan, 2**31])
def test_a_block_runs_in_every_whole_number_of_ticks(every):
    found = refusal(Gain, every=every)
    assert (found.code, found.message) == ("TW014", f"every must be a whole number of ticks, 1 or more, got {every!r}")


def test_a_live_parameter_needs_both_bounds():
    with pytest.raises(TypeError, match="both bounds"):
        Param(1.0, "1", min=0.0, live=True)


def test_an_invalid_unit_is_rejected_at_its_declaration():
    with pytest.raises(ValueError, match="'newton' is not a unit"):
        Input("newton")


def test_a_step_accepts_only_inputs_and_the_clock():
    with pytest.raises(TypeError, match=r"Odd.step takes 'w', which is neither an input \(u\) nor one of t, tick, dt"):

        class Odd(Block):
            """Takes what is no input."""

            u = Input("1")

            def step(self, u, w):
                return u

    with pytest.raises(TypeError, match=r"Named.step takes 't' by name only"):

        class Named(Block):
            """Asks by name."""

            u = Input("1")

            def step(self, u, *, t):
                return u


def test_an_exception_in_update_is_held_like_one_in_step():
    with pytest.raises(TypeError, match=r"Odd.update takes 'w', which is neither an input \(none\)"):

        class Odd(Block):
            """Updates from what is no input."""

            def update(self, w):
                pass


@pytest.mark.parametrize("shape", [3, [3], (0,), (-1,), (2.0,), "3", None])
def test_a_shape_is_a_tuple_of_lengths(shape):
    with pytest.raises(TypeError, match="shape must be a tuple of lengths, as in"):
        Output("1", shape=shape)


@pytest.mark.parametrize("dtype", [str, np.float64, "double", None])
def test_a_dtype_is_one_of_three(dtype):
    with pytest.raises(TypeError, match="dtype must be float, int or bool"):
        Input("1", dtype=dtype)


def test_a_misspelt_port_is_missed_as_python_misses_it_and_no_attribute_of_a_block_is_found_by_detours():
    with Diagram("d", rate=100):
        impedance = Impedance()
    with pytest.raises(AttributeError) as caught:
        impedance.torqe
    assert (caught.value.name, caught.value.obj) == ("torqe", impedance)  # what a suggestion is made from
    assert not hasattr(Impedance, "__getattr__") and Impedance.__getattribute__ is object.__getattribute__


@pytest.mark.parametrize("word", ["path", "width", "dt", "kernel", "inputs", "name", "every", "reset", "diagram"])
def test_a_reserved_word_cannot_name_a_port_or_parameter(word):
    for declaration in (Param(1.0), Input("1"), Output("1"), Memory(0.0)):
        with pytest.raises(TypeError, match=f"Taken: '{word}' is reserved .* {word}"):
            type("Taken", (Block,), {word: declaration})


def test_the_page_lists_the_reserved_words():
    page = (ROOT / "docs" / "how_to" / "blocks.md").read_text()
    listed = page.partition("These names are reserved: ")[2].partition(".")[0]
    assert re.findall(r"`(\w+)`", listed) == sorted(_WORDS)


def test_completion_offers_ports_and_parameters_and_no_internals():
    class Spring(Block):
        angle, torque = Input("rad"), Output("N·m")
        stiffness = Param(3.0)
        memory_of_steps = Memory(0.0)

        def step(self, angle):
            return -self.stiffness * angle

        def energy(self, angle):
            return self.stiffness * angle**2 / 2

    completed = ["dt", "path", "reset", "set", "step", "update"]
    assert dir(Spring()) == sorted(["angle", "energy", "memory_of_steps", "stiffness", "torque", *completed])
    declared = [name for kind in ("inputs", "outputs", "parameters") for name in getattr(Impedance, kind)]
    assert dir(Impedance()) == sorted([*declared, *completed])
    functions = ["check", "connect", "linearise", "load", "optimise", "run", "simulate", "study", "trim"]
    assert dir(runtime) == functions


def test_a_step_with_any_number_of_inputs_receives_them_in_order():
    class Most(Block):
        """The largest of its inputs."""

        a = Input("1")
        b = Input("1")
        c = Input("1")
        y = Output("1")

        def step(self, t, *inputs):
            return max(inputs)

    assert Most().step_inputs() == ["t", "a", "b", "c"]


def test_the_signature_of_a_decorated_step_is_used():
    def logged(step):
        @functools.wraps(step)
        def wrapper(*arguments):
            return step(*arguments)

        return wrapper

    class Decorated(Block):
        """Its step is wrapped."""

        u = Input("1")
        v = Input("1")
        y = Output("1")

        @logged
        def step(self, v):
            return v

    assert Decorated().step_inputs() == ["v"]


def test_a_block_inherits_ports_and_may_replace_them():
    class Base(Block):
        """One port and one parameter."""

        scale = Param(1.0)
        u = Input("rad")
        y = Output("rad")

        def step(self, u):
            return self.scale * u

    class Derived(Base):
        """Replaces one, adds one, takes one away."""

        u = Input("deg")
        v = Input("1", default=0.0)
        scale = None

    assert list(Derived.inputs) == ["u", "v"] and Derived.inputs["u"].unit == "deg" and Base.inputs["u"].unit == "rad"
    assert list(Derived.parameters) == [] and list(Base.parameters) == ["scale"]


def test_a_block_wired_outside_a_diagram_suggests_to_call_step():
    gain = Gain(2.0)
    found = refusal(gain, 1.0)
    assert (found.code, found.path) == ("TW011", "gain") and "call .step(...)" in found.hint
    assert gain.step(1.5) == 3.0


def test_an_unknown_input_is_reported_with_a_suggestion():
    with Diagram("d", rate=100):
        impedance = Impedance()
        found = refusal(impedance, positon=1.0)
        assert (found.code, found.message, found.hint) == (
            "TW012",
            "has no input 'positon'",
            "did you mean 'position'?",
        )
        assert refusal(impedance, torque=1.0).hint == "torque is an output; its inputs are position, velocity, " + (
            "equilibrium, extra_stiffness, extra_damping"
        )
        assert refusal(impedance, 1, 2, 3, 4, 5, 6).message == (
            "has 5 inputs (position, velocity, equilibrium, extra_stiffness, extra_damping), got 6 signals"
        )


def test_a_hook_that_raises_a_value_error_is_reported_at_the_users_line():
    with pytest.raises(DiagramError) as caught:
        at = here(1)
        Saturation(2.0, 1.0)
    (found,) = caught.value.diagnostics
    assert (found.code, found.message, found.where) == ("TW010", "lower must be at most upper (1), got 2", at)


def test_class_names_make_block_names():
    assert [
        snake_case(name)
        for name in ("TorqueLimiter", "PID", "CubeMars", "RMSLimit", "Mpu9250", "Mpu9250Imu", "LookupTable1D")
    ] == ["torque_limiter", "pid", "cube_mars", "rms_limit", "mpu9250", "mpu9250_imu", "lookup_table_1d"]
    assert TorqueLimiter(limit=1.0).path == "torque_limiter" and TorqueLimiter(limit=1.0, name="Hüfte").path == "Hüfte"


def test_command_line_text_becomes_a_value_with_its_unit():
    parameters = Everything.parameters
    assert parameters["optional"].parse("60 deg") == pytest.approx(deg(60))
    assert parameters["number"].parse("-1e0 N*m") == -1.0
    assert parameters["count"].parse("4") == 4 and type(parameters["count"].parse("4")) is int
    assert parameters["count"].parse("0x03") == 3
    assert parameters["flag"].parse("Yes") is True and parameters["text"].parse("b") == "b"
    for name, text, complaint in (
        ("number", "one", "'one' is not a number"),
        ("number", "1 rad", "rad does not convert to N·m"),
        ("number", "3", "at most 2.0"),
        ("count", "2.5", "whole number"),
        ("count", "inf", "whole number"),
        ("flag", "maybe", "expected true or false, got 'maybe'"),
        ("text", "c", "must be one of a, b"),
        ("number", "nan", "NaN is not allowed"),
    ):
        with pytest.raises(ValueError, match=complaint):
            parameters[name].parse(text)


def test_blocks_share_no_state_with_others_of_their_class():
    first, second = Sum("+-"), Sum("+++")
    assert list(first.inputs) == ["u1", "u2"] and list(second.inputs) == ["u1", "u2", "u3"] and Sum.inputs == {}
    assert first.weights == [1.0, -1.0] and second.weights == [1.0, 1.0, 1.0]


def test_all_filters_above_the_nyquist_frequency_are_reported_at_compile():
    with Diagram("d", rate=30) as diagram:
        Butterworth(cutoff=20.0, name="a")(1.0)
        at = here(-1)
        Butterworth(cutoff=16.0, name="b")(2.0)
    found = complaints(diagram)
    assert [(d.code, d.path) for d in found] == [("TW010", "a"), ("TW010", "b")] and found[0].where == at
    assert found[0].message == "a cutoff of 20 Hz requires a rate above 40 Hz, got 30 Hz"
