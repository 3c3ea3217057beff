"""A kernel names its items: a class declares each of them, and may declare whatever else it likes."""

import ctypes
import math

import pytest

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.discrete import Integrator
from blocks.filters import Butterworth, Exponential
from blocks.limiters import RMSTorqueLimiter, TorqueLimiter
from blocks.linear import StateSpace
from blocks.logic import Compare
from blocks.mathematics import Max, Round
from blocks.states import StateMachine
from cext.kernels import limiters as kernels
from cext.kernels import mathematics
from graph import Block, Diagram, DiagramError, Input, Interval, Kernel, Memory, Output, Param, compile
from graph.conformance import check_block
from tests.blocks.actuators.wire import Wired
from tests.blocks.running import player, run


def refusal(make):
    with pytest.raises(TypeError) as error:
        make()
    return str(error.value)


def a_subclass(*bases, **body):
    return lambda: type("WearerLimiter", bases, {"__doc__": "A limiter for a wearer.", **body})


# What a subclass may do

MORE = {
    "mass": Param(70.0, "kg", "of the wearer", min=0.0, max=200.0, live=True),
    "factor": Param(0.5, "1", "share", fixed=True),
    "velocity_in": Input("rad/s", "of the joint", default=0.0),
    "peak": Output("N·m", "largest", range=(0.0, 0.0)),
    "note": Memory((1.0, 2.0, 3.0), "of the lab"),
}


@pytest.mark.parametrize(
    "base, parameters, inputs",
    [
        (RMSTorqueLimiter, {"limit": 3.0, "window": 0.05, "fade": 0.01}, {"N·m": [8.0, -9.0, 2.0, 7.0] * 8}),
        (TorqueLimiter, {"limit": 5.0, "slew": 40.0}, {"N·m": [9.0, -9.0, 4.0, 1.0]}),
        (Exponential, {"time_constant": 0.1}, {"1": [1.0, 0.0, 3.0, 2.0]}),
        (Butterworth, {"order": 4, "cutoff": 20.0}, {"1": [1.0, 0.0, 3.0, 2.0]}),
        (Integrator, {"method": "trapezoidal"}, {"1": [1.0, 2.0, 3.0]}),
        (Compare, {"relation": "<"}, {"1": [1.0, 2.0]}),
        (Round, {"method": "floor"}, {"1": [1.5, -1.5]}),
        (Impedance, {}, {"rad": [0.1, 0.2], "rad/s": [1.0, -1.0]}),
    ],
)
def test_a_subclass_with_more_items_computes_as_its_base(base, parameters, inputs):
    body = {name: item for name, item in MORE.items() if name != "velocity_in"}
    kind = a_subclass(base, **body)()

    def outputs(kind):
        with Diagram("d", rate=200) as diagram:
            block = kind(name="block", **parameters)
            signals = [player(values, unit) for unit, values in inputs.items()]
            block(*(signals * 2 if base is Compare else signals))
        table = run(diagram, len(list(inputs.values())[0]))
        return [table[f"block.{name}"].tolist() for name in base.outputs]

    assert outputs(kind) == outputs(base)


def test_an_additional_input_shifts_no_slot():
    kind = a_subclass(TorqueLimiter, velocity=Input("rad/s", "of the joint", default=0.0))()
    assert [kind(5.0, 1e6).step(torque) for torque in (3.0, 9.0)] == [3.0, 5.0]


def test_items_in_another_order_are_found_by_name():
    class Swapped(Block):
        """The parameters of a limiter in the reverse order."""

        slew = Param(1e6, "N·m/s", "fastest change", min=0.0)
        limit = Param(1.0, "N·m", "largest torque", min=0.0)

    kind = a_subclass(TorqueLimiter, Swapped)()
    assert list(kind.parameters) == ["slew", "limit"] and kind(slew=1e6, limit=4.0).step(9.0) == 4.0


def test_a_base_class_with_its_own_items_may_be_first_or_last():
    class Weighed(Block):
        """Something with a mass."""

        mass = Param(70.0, "kg", "of the wearer", min=0.0)

    for bases in ((Weighed, TorqueLimiter), (TorqueLimiter, Weighed)):
        assert a_subclass(*bases)()(limit=2.0, slew=1e6).step(9.0) == 2.0


def test_variadic_blocks_accept_additional_outputs_parameters_and_memory():
    extra = {name: MORE[name] for name in ("mass", "factor", "peak", "note")}
    assert a_subclass(Max, **extra)()(3).step(1.0, 5.0, 2.0)[0] == 5.0
    machine = a_subclass(StateMachine, **extra)()
    example = StateMachine.examples[0]
    with Diagram("d", rate=200) as diagram:
        for kind, name in ((machine, "ours"), (StateMachine, "theirs")):
            kind(name=name, **example)(player([0.0, 2.0, 2.0, -2.0], "1"))
    table = run(diagram, 4)
    assert table["ours.y"].tolist() == table["theirs.y"].tolist() == [0.0, 1.5, 1.5, 1.5]


def test_a_subclass_of_a_drive_sends_and_reads_the_same_frames():
    more = {name: MORE[name] for name in ("factor", "peak", "note")}
    drives = [Wired(kind, "AK80-9", can_id=3) for kind in (CubeMars, a_subclass(CubeMars, **more)())]
    frames = [drive.say(torque_command=2.5, stiffness_command=10.0) for drive in drives]
    reply = bytes([3, 0x90, 0x12, 0x7F, 0x38, 0x00, 60, 0])
    assert frames[0] == frames[1] and len(frames[0]) == 1
    assert [drive.hear(3, reply) for drive in drives] == [1, 1]
    assert drives[0]["position"] == drives[1]["position"] != 0.0


def test_a_subclass_with_another_parameter_keeps_its_limit():
    class Rated(RMSTorqueLimiter):
        """Bounds the root mean square of a torque for a wearer of some mass."""

        window = Param(0.05, "s", "a short one", above=0.0, fixed=True)
        fade = Param(0.01, "s", "shorter still", min=0.0, fixed=True)
        mass = Param(70.0, "kg", "of the wearer", min=1.0, max=200.0, fixed=True)
        examples = ({"limit": 3.0},)

    with Diagram("wearer", rate=200) as diagram:
        Rated(limit=3.0, mass=140.0, name="limiter")(player([100.0] * 200, "N·m"))
    limited = run(diagram, 200)["limiter.limited"]
    rms = max((sum(limited[k : k + 10] ** 2) / 10) ** 0.5 for k in range(190))
    assert 2.95 < rms <= 3.0 and check_block(Rated) > 0


# What is refused when the class is made


def test_an_item_that_is_missing_is_refused_with_class_kernel_item_and_remedy():
    class Other(Block):
        """A block with other items."""

        torque = Input("N·m", "asked for")
        limited = Output("N·m", "let through")

    assert refusal(a_subclass(Other, kernel=kernels.torque_limiter)) == (
        "WearerLimiter.kernel needs 'limit', and WearerLimiter does not declare 'limit': declare it as an input, "
        "an output, a parameter or memory, or give the class a kernel that does not need it"
    )


@pytest.mark.parametrize(
    "body, problem",
    [
        ({"limit": 20.0}, "needs 'limit', and WearerLimiter does not declare 'limit'"),
        ({"ticks": None}, "needs 'ticks', and WearerLimiter does not declare 'ticks'"),
        (
            {"limited": Output("N·m", "let through", kernel=False)},
            "needs 'limited', and the output 'limited' is declared with kernel=False: leave that out",
        ),
        ({"limit": Param("high", "N·m", "largest")}, "needs 'limit', and the parameter 'limit' is not a number"),
        (
            {"limit": Param(1.0, "N·m", "largest", fixed=True, kernel=False)},
            "needs 'limit', and the parameter 'limit' is not a number in the arena: declare a number, without",
        ),
        (
            {"torque": Input("N·m", "asked for", shape=...)},
            "needs 'torque', and 'torque' is declared with shape=...: declare a port of one number",
        ),
        (
            {"torque": Input("N·m", "asked for", shape=(3,))},
            "needs 'torque', and 'torque' is declared with shape=(3,): declare a port of one number",
        ),
        (
            {"squares": Param(1.0, "1", "a memory that became a parameter")},
            "needs 'squares[...]', and the parameter 'squares' is one number",
        ),
    ],
)
def test_an_item_with_another_shape_is_rejected(body, problem):
    text = refusal(a_subclass(RMSTorqueLimiter, **body))
    assert f"WearerLimiter.kernel {problem}" in text and text.endswith(
        "or give the class a kernel that does not need it"
    )


@pytest.mark.parametrize(
    "base, item, attribute",
    [(Round, "y", "kernel"), (Integrator, "held", "kernel"), (StateSpace, "u", "kernel"), (CubeMars, "wire", "decode")],
)
def test_every_kernel_of_a_class_is_checked_those_of_devices_too(base, item, attribute):
    assert f"WearerLimiter.{attribute} needs" in refusal(a_subclass(base, **{item: None}))


def test_a_function_pointer_that_does_not_name_its_items_is_refused():
    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    def bare(arena, slots, sizes):
        return 0

    text = refusal(a_subclass(Block, kernel=bare))
    assert text.startswith("WearerLimiter.kernel is <")
    assert text.endswith(
        "which does not name its items: wrap it with their names in the order of its slots, "
        'kernel = Kernel(function, "u[...] y[...] gain")'
    )
    capsule = mathematics.gain.function
    assert "which does not name its items" in refusal(a_subclass(Block, decode=capsule))


def test_memory_of_another_length_is_refused_when_the_diagram_is_compiled():
    class Short(RMSTorqueLimiter):
        """A limiter whose author sets a memory too short."""

        def prepare(self, dt):
            super().prepare(dt)
            self.sums = [0.0]

    with Diagram("d", rate=200) as diagram:
        Short(3.0, name="short")(player([1.0], "N·m"))
    with pytest.raises(TypeError, match="short: a kernel of Short requires .* numbers in 'sums', got 1"):
        compile(diagram)


def test_a_kernel_of_an_instance_is_checked_when_the_diagram_is_compiled():
    class Chooser(Block):
        """A block whose author chooses a kernel without its items."""

        u = Input("any", "input", shape=...)
        y = Output("any", "output", shape=...)
        kernel = mathematics.magnitude

        def configure(self):
            self.kernel = mathematics.gain

    with Diagram("d", rate=200) as diagram:
        Chooser()(player([1.0], "1"))
    with pytest.raises(DiagramError, match="Chooser.kernel needs 'gain', and Chooser does not declare 'gain'"):
        compile(diagram)


def test_a_step_in_python_replaces_the_kernels_and_may_have_any_items():
    class InPython(Butterworth):
        """A filter whose author wrote the step anew."""

        gain = Param(2.0, "1", "factor")

        def step(self, u):
            return self.gain * u

        def output_range(self, u):
            return Interval(-math.inf, math.inf)

    with Diagram("python", rate=200) as diagram:
        InPython(name="filter")(player([1.0, 2.0]))
    assert compile(diagram).settle == [] and run(diagram, 2)["filter.y"].tolist() == [2.0, 4.0]


def test_a_class_that_selects_a_kernel_in_configure_must_name_one():
    class Secret(Block):
        """A block whose kernel is nowhere to be seen."""

        lower = Param(-1.0, "any", "smallest output")
        upper = Param(1.0, "any", "largest output")
        u = Input("any", "input", shape=...)
        y = Output("any", "clipped", shape=...)

        def configure(self):
            self.kernel = kernels.saturation

    assert "Secret chooses its kernel in configure: also name one of them on the class" in refusal(Secret)


def test_check_block_refuses_a_class_whose_items_were_changed_afterwards():
    class Late(TorqueLimiter):
        """A limiter that is changed once it is made."""

        examples = ({"limit": 2.0},)

    check_block(Late)
    Late.parameters = {"limit": Late.parameters["limit"]}
    with pytest.raises(AssertionError, match="Late.kernel needs 'slew', and Late does not declare 'slew'"):
        check_block(Late)


# The list


def test_a_kernel_of_cython_names_the_fields_of_its_struct_and_those_of_the_structs_in_it():
    assert str(mathematics.sum) == "<Kernel y[...] weights[...] *inputs>"
    assert CubeMars.decode.names[:3] == ["position_command", "velocity_command", "torque_command"]
    assert "reply" in CubeMars.decode.names


def test_a_kernel_can_be_renamed_for_a_block_with_other_names():
    class Attenuator(Block):
        """y = share u."""

        share = Param(0.5, "1", "factor")
        u = Input("any", "input")
        y = Output("any", "output")
        kernel = mathematics.gain.renamed(gain="share")

    assert Attenuator(0.25).step(8.0) == 2.0
    with pytest.raises(ValueError, match="has no item 'factor'; its items are u, y, gain"):
        mathematics.gain.renamed(factor="share")


@pytest.mark.parametrize(
    "items, message",
    [
        ("u y u", "lists item 'u' twice"),
        ("u y[2,3]", "invalid kernel item 'y\\[2,3\\]'"),
        ("u *memory", "invalid kernel item '\\*memory'"),
        ("*inputs[3]", "invalid kernel item"),
    ],
)
def test_an_invalid_list_of_items_is_rejected(items, message):
    with pytest.raises(ValueError, match=message):
        Kernel(None, items)
