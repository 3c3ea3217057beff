"""Shapes and units found along wires, in a time that grows with their number."""

import sys

import pytest

from blocks.controllers import PID
from blocks.discrete import Derivative, Integrator, UnitDelay
from blocks.linear import TransferFunction
from blocks.logic import Switch
from blocks.mathematics import Divide, Gain, Product, Sum
from blocks.sources import Constant, Sine
from blocks.tables import LookupTable2D
from blocks.trigonometry import Atan2
from blocks.vectors import Cross, Dot
from graph import Block, Diagram, Input, Output, compile, stack
from tests.graph.complaints import complaint, complaints, here


class Angle(Block):
    """An angle."""

    angle = Output("rad")

    def step(self):
        return 0.5


class Torque(Block):
    """A torque."""

    torque = Output("N·m")

    def step(self):
        return 1.0


class Triple(Block):
    """A vector."""

    u = Input("any", default=0.0)
    y = Output("rad/s", shape=(3,))

    def step(self, u):
        return u, u, u


class TakesTorque(Block):
    """Asks for a torque."""

    torque = Input("N·m")
    y = Output("1")

    def step(self, torque):
        return torque


class TakesPair(Block):
    """Asks for two numbers."""

    u = Input("any", shape=(2,))
    y = Output("1")

    def step(self, u):
        return float(u[0])


def unit_of(schedule, path):
    return schedule.signals[path].unit


def test_a_unit_mismatch_is_reported_with_both_units_the_source_and_the_line():
    with Diagram("d", rate=100) as diagram:
        angle = Angle()
        takes = TakesTorque(name="takes")
        takes(angle.angle)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW002", "takes", "torque", at)
    assert found.message == "expected N·m, got rad from angle.angle"
    assert found.hint == ""  # no conversion makes a torque of an angle


def test_a_unit_mismatch_suggests_a_conversion():
    class TakesDegrees(Block):
        """Asks for degrees."""

        angle = Input("deg")
        y = Output("1")

        def step(self, angle):
            return angle

    with Diagram("d", rate=100) as diagram:
        TakesDegrees()(Angle().angle)
    found = complaint(diagram)
    assert found.message == "expected deg, got rad from angle.angle"
    assert "signal.to('deg')" in found.hint


def test_a_unit_mismatch_is_found_behind_a_chain_of_any_blocks():
    with Diagram("d", rate=100) as diagram:
        signal = Angle().angle
        for _ in range(12):
            signal = UnitDelay()(Sum("++")(signal, 1.0))
        TakesTorque(name="takes")(signal)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW002", "takes", "torque", at)
    assert "expected N·m, got rad from unit_delay_12.y" in found.message


def test_signals_in_different_units_cannot_be_added():
    with Diagram("d", rate=100) as diagram:
        total = Sum("++", name="total")
        total(Angle().angle, Torque().torque)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW002", "total", "u2", at)
    assert found.message == "expected rad, got N·m from torque.torque"


def test_gains_and_products_multiply_units():
    with Diagram("d", rate=100) as diagram:
        stiff = Gain(30.0, unit="N*m/rad")(Angle().angle)
        TakesTorque()(stiff)
        Product(name="work")(stiff, Angle().angle)
    schedule = compile(diagram)
    assert unit_of(schedule, "gain.y") == "N·m"
    assert unit_of(schedule, "work.y") == "N·m·rad"


def test_a_loop_whose_gain_has_a_unit_terminates_and_is_a_mismatch():
    with Diagram("d", rate=100) as diagram:
        total, delay = Sum("++", name="total"), UnitDelay()
        total(delay.y, Angle().angle)
        delay(Gain(0.01, unit="s")(total.y))
    found = complaint(diagram)
    assert (found.code, found.path) == ("TW002", "total")
    assert found.message == "expected rad, got s·rad from unit_delay.y"


def test_a_loop_of_any_ports_remains_any():
    with Diagram("d", rate=100) as diagram:
        delay = UnitDelay()
        delay(Gain(0.5)(Sum("++")(delay.y, 1.0)))
    assert unit_of(compile(diagram), "unit_delay.y") == "any"


def test_an_invalid_unit_is_reported_at_the_block_that_declares_it():
    class Claims(Gain):
        def output_units(self, u):
            return {"y": "newton"}

    with Diagram("d", rate=100) as diagram:
        Claims(2.0, name="claims")(Angle().angle)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.where) == ("TW010", "claims", at)
    assert "'newton' is not a unit" in found.message


def test_a_shape_mismatch_is_reported_with_both_shapes():
    with Diagram("d", rate=100) as diagram:
        takes = TakesPair(name="takes")
        takes(Gain()(Triple().y))
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW003", "takes", "u", at)
    assert found.message == "expected shape (2,), got (3,) from gain.y"


def test_a_vector_passes_blocks_of_any_shape_and_a_number_fits_it():
    with Diagram("d", rate=100) as diagram:
        Sum("+-", name="total")(UnitDelay()(Triple().y), 1.0)
    schedule = compile(diagram)
    assert schedule.signals["total.y"].shape == (3,) == schedule.signals["unit_delay.y"].shape


def test_a_scalar_and_a_vector_do_not_add():
    with Diagram("d", rate=100) as diagram:
        Sum("++", name="total")(Triple().y, Sine().y)
    found = complaint(diagram)
    assert (found.code, found.port, found.message) == ("TW003", "u2", "expected shape (3,), got () from sine.y")


def test_a_constant_vector_of_the_wrong_length_is_a_mismatch():
    with Diagram("d", rate=100) as diagram:
        TakesPair(name="takes")([1.0, 2.0, 3.0])
    found = complaint(diagram)
    assert (found.code, found.path, found.message) == ("TW003", "takes", "expected shape (2,), got (3,)")


@pytest.mark.soak
def test_names_in_an_awkward_order_do_not_make_a_long_chain_slow():
    def calls_of_compile(count):
        with Diagram("chain", rate=100) as diagram:
            signal = Angle(name="z").angle
            for block in [Gain(name=f"g{count - i:05}") for i in range(count)]:
                signal = block(signal)
        calls = 0

        def count_call(frame, event, argument):
            nonlocal calls
            calls += event in ("call", "c_call")

        sys.setprofile(count_call)
        try:
            compile(diagram)
        finally:
            sys.setprofile(None)
        return calls

    # ten times the blocks; a quadratic compile needs 100 times as many
    assert calls_of_compile(1000) < 12 * calls_of_compile(100)


def test_every_mismatch_of_a_diagram_is_reported():
    with Diagram("d", rate=100) as diagram:
        for number in range(5):
            TakesTorque(name=f"takes{number}")(Angle().angle)
    assert [d.path for d in complaints(diagram)] == [f"takes{number}" for number in range(5)]


def in_unit(unit):
    return Constant(1.0, unit=unit)()


@pytest.mark.parametrize("make", [PID, lambda: Sum("+-"), Switch, Atan2, lambda: PID(unit="N·m")])
def test_inputs_that_are_compared_or_added_share_one_unit(make):
    with Diagram("d", rate=100) as diagram:
        block = make()
        first, second = [name for name, port in block.inputs.items() if port.unit == "any"][:2]
        wires = {"condition": True} if "condition" in block.inputs else {}
        block(**wires, **{first: in_unit("rad"), second: in_unit("deg")})
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.port, found.where) == ("TW002", second, at)
    assert found.message.startswith("expected rad, got deg from") and "signal.to('rad')" in found.hint


def test_a_block_that_computes_the_unit_of_its_output_still_holds_its_inputs_to_one():
    class Work(Block):
        """The square root of the sum of two squares, times a second."""

        a = Input("any", "one")
        b = Input("any", "other")
        y = Output("any", "sum")

        def output_units(self, a, b):
            return {"y": f"{a}·s" if a != "any" else "any"}

        def step(self, a, b):
            return a + b

    with Diagram("d", rate=100) as diagram:
        Work(name="work")(in_unit("rad"), in_unit("N·m"))
    assert complaint(diagram).message == "expected rad, got N·m from constant_2.y"


@pytest.mark.parametrize(
    "make, unit", [(Product, "N·m·rad"), (Divide, "rad/N/m"), (lambda: LookupTable2D(unit="A"), "A")]
)
def test_factors_and_axes_have_units_of_their_own(make, unit):
    with Diagram("d", rate=100) as diagram:
        block = make()
        block(in_unit("rad"), in_unit("N·m"))
    assert unit_of(compile(diagram), f"{block.path}.y") == unit


def test_vector_products_multiply_units():
    with Diagram("d", rate=100) as diagram:
        for kind in (Dot, Cross):
            kind(name=kind.__name__)(stack(*[in_unit("N")] * 3), stack(*[in_unit("m")] * 3))
    schedule = compile(diagram)
    assert unit_of(schedule, "Dot.y") == unit_of(schedule, "Cross.y") == "N·m"


@pytest.mark.parametrize(
    "make, unit",
    [
        (Derivative, "rad/s"),
        (Integrator, "s·rad"),
        (lambda: TransferFunction((1.0,), (1.0, -0.5), unit="N*m/rad"), "N·m"),
        (UnitDelay, "rad"),
    ],
)
def test_time_enters_the_unit_of_a_derivative_and_an_integral(make, unit):
    with Diagram("d", rate=100) as diagram:
        block = make()
        block(in_unit("rad"))
    assert unit_of(compile(diagram), f"{block.path}.y") == unit
