"""Diagrams: names, subsystems, wires, and what is refused while they are made."""

import math
from contextlib import ExitStack
from fractions import Fraction

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase
from blocks.limiters import Saturation
from blocks.mathematics import Gain, Sum
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.user_text import repr_of
from graph import Diagram, DiagramError, compile, subsystem
from tests.graph.complaints import complaint, complaints, here, refusal


@pytest.mark.parametrize("rate", [0, -1, math.inf, math.nan, "200", None, 1j])
def test_a_rate_is_a_number_above_zero(rate):
    found = refusal(Diagram, "d", rate)
    assert found.code == "TW010" and found.message == (
        f"the rate must be a number above 0 Hz and at most 1e+09 Hz, got {rate!r}"
    )
    assert found.where.file == refusal.__code__.co_filename


def test_an_overflowing_rate_is_rejected_in_one_short_line():
    message = refusal(Diagram, "d", 10**400).message
    assert message.startswith("the rate must be a number above 0 Hz and at most 1e+09 Hz, got 10000000000000000000")
    assert message.endswith("... (401 characters)") and len(message) < 130


@pytest.mark.parametrize("rate", [1, 0.5, np.float32(200), np.int64(200), Fraction(400, 3)])
def test_any_real_number_is_a_rate(rate):
    with Diagram("d", rate=rate) as diagram:
        Gain()(Sine().y)
    assert compile(diagram).rate == rate and diagram["gain"].dt == pytest.approx(1.0 / float(rate))


def test_subsystems_make_paths_and_end_with_their_with():
    with Diagram("d", rate=100) as diagram:
        with subsystem("left"):
            with subsystem("knee"):
                inner = Gain(name="g")
            outer = Gain(name="g")
        top = Gain(name="g")
    assert [block.path for block in diagram] == ["left/knee/g", "left/g", "g"] == [inner.path, outer.path, top.path]
    assert diagram["left/knee/g"] is inner and len(diagram) == 3


def test_a_block_that_could_not_be_made_is_not_in_the_diagram():
    with Diagram("d", rate=100) as diagram:
        sine = Sine(name="wave")
        for name in ("stop", "wave"):
            with pytest.raises(DiagramError, match=r"lower must be at most upper \(2\), got 3"):
                Saturation(3.0, 2.0, name=name)
        Saturation(2.0, 3.0, name="stop")(sine.y)
    assert list(diagram.blocks) == ["wave", "stop"] and "stop.y" in compile(diagram).signals


def test_fifty_nested_subsystems_form_a_path():
    with Diagram("d", rate=100) as diagram, ExitStack() as scopes:
        for depth in range(50):
            scopes.enter_context(subsystem(f"level{depth}"))
        Gain(name="deep")(Sine().y)
    path = "/".join(f"level{depth}" for depth in range(50)) + "/deep"
    assert compile(diagram).signals[f"{path}.y"].path == f"{path}.y"


def test_a_subsystem_outside_a_diagram_is_reported_at_its_own_line():
    with pytest.raises(DiagramError) as caught:
        at = here(1)
        subsystem("left")
    (found,) = caught.value.diagnostics
    assert (found.code, found.where) == ("TW011", at) and found.message == "subsystem('left') is outside a diagram"


@pytest.mark.parametrize("name", ["", " ", "a/b", "a.b", "a=b", "a\nb", 3, b"a"])
def test_a_name_is_text_that_a_path_can_carry(name):
    with Diagram("d", rate=100):
        assert refusal(Gain, name=name).message == f"{name!r} cannot be a name"
        assert refusal(subsystem, name).message == f"{name!r} cannot be a name"
    assert refusal(Diagram, name, 100).message == f"{name!r} cannot be a name"


def test_a_name_is_short_enough_for_a_file():
    message = refusal(Diagram, "k" * 300, 100).message
    assert message.endswith("... (302 characters) cannot be a name") and len(message) < 160


@pytest.mark.parametrize("bus", ["le/gs", "le\x1bgs"])
def test_bus_names_are_checked_like_block_names(bus):
    with Diagram("d", rate=100) as diagram:
        CubeMars("AK80-9", bus=bus, name="knee")
    found = complaints(diagram)[0]
    assert found.message == f"its bus: {bus!r} cannot be a name" and found.path == "knee"


def test_names_may_be_of_any_script():
    with Diagram("Knie", rate=100) as diagram, subsystem("左"):
        Gain(name="Verstärkung α")(Sine(name="σῆμα").y)
    assert sorted(compile(diagram).signals) == ["左/Verstärkung α.y", "左/σῆμα.y"]


def test_blocks_without_a_name_are_numbered_and_a_given_name_is_kept():
    with Diagram("d", rate=100) as diagram:
        paths = [Gain().path, Gain(name="gain_3").path, Gain().path, Gain().path, Gain().path]
    assert paths == ["gain", "gain_3", "gain_2", "gain_4", "gain_5"]
    assert diagram.duplicates == []


def test_a_name_given_twice_names_both_lines():
    with Diagram("d", rate=100) as diagram:
        Gain(name="same")(1.0)
        first = here(-1)
        Gain(name="same")(2.0)
        second = here(-1)
        Gain(name="same")(3.0)
        third = here(-1)
    found = complaints(diagram)
    assert [(d.code, d.where) for d in found] == [("TW009", second), ("TW009", third)]
    assert (
        found[0].message == f"the name 'same' is already used by the block made at {first}"
        and found[0].hint == "choose a different `name=`"
    )


def test_the_same_name_in_two_subsystems_is_two_names():
    with Diagram("d", rate=100) as diagram:
        for side in ("left", "right"):
            with subsystem(side):
                Gain(name="g")(Sine().y)
    assert {"left/g.y", "right/g.y"} <= set(compile(diagram).signals)


def test_a_wire_between_two_diagrams_is_refused_at_its_line():
    with Diagram("first", rate=100):
        sine = Sine()
    with Diagram("second", rate=100):
        gain = Gain()
        with pytest.raises(DiagramError) as caught:
            at = here(1)
            gain(sine.y)
    (found,) = caught.value.diagnostics
    assert (found.code, found.path, found.port, found.where) == ("TW011", "gain", "u", at)
    assert found.message == "the signal sine.y comes from a block that is not in this diagram"


def test_a_signal_of_a_block_outside_every_diagram_is_refused():
    sine = Sine()
    with Diagram("d", rate=100):
        assert refusal(Gain(), sine.y).code == "TW011"


def test_a_diagram_may_be_left_and_entered_again_also_within_another():
    with Diagram("a", rate=100) as a:
        with Diagram("b", rate=100) as b:
            with a:
                Gain(name="one")(1.0)
            Gain(name="two")(1.0)
        Gain(name="three")(1.0)
    with a:
        Gain(name="four")(1.0)
    assert [block.path for block in a] == ["one", "three", "four"] and [block.path for block in b] == ["two"]
    assert Gain().diagram is None


def test_an_exception_in_a_with_statement_closes_its_scope():
    with pytest.raises(RuntimeError), Diagram("d", rate=100), subsystem("left"):
        raise RuntimeError
    assert Gain().diagram is None


@pytest.mark.parametrize("source", [None, "1.0", "abc", object(), [1.0, [2.0]], 1j, {"a": 1}, math, [], 10**400])
def test_a_value_other_than_a_signal_or_number_is_rejected(source):
    with Diagram("d", rate=100):
        gain = Gain(name="g")
        found = refusal(gain, source)
    assert (found.code, found.path, found.port) == ("TW012", "g", "u")
    assert found.message == f"{repr_of(source)} is neither a signal nor a number"


def test_a_block_used_in_place_of_its_output_is_reported():
    with Diagram("d", rate=100):
        found = refusal(Gain(), CubeMars("AK80-9"))
    assert found.code == "TW012" and found.hint.startswith("choose an output of cube_mars: position, velocity, torque,")


def test_a_block_with_several_outputs_requires_one_by_name():
    with Diagram("d", rate=100):
        phase = GaitPhase()(0.0, 0.0)
        found = refusal(Gain(), phase)
    assert found.message == "expected one signal, got 5 (phase, walking, stride_time, strides, uncertainty)"


def test_outputs_are_returned_by_position_and_by_name():
    with Diagram("d", rate=100):
        outputs = GaitPhase()(angle=0.0, velocity=0.0)
        phase, walking, *_ = outputs
    assert outputs.phase is phase and walking.path == "gait_phase.walking" and walking.declaration.dtype == "bool"


def test_a_number_cannot_be_recorded():
    with Diagram("d", rate=100):
        assert refusal(CsvRecorder(), 1.0).code == "TW012"


def test_a_signal_has_no_value_before_the_diagram_runs():
    with Diagram("d", rate=100):
        sine = Sine()
        with pytest.raises(TypeError, match="sine.y is a signal, which has no value until the diagram runs"):
            if sine.y:
                pass


def test_an_unknown_block_is_reported_with_a_suggestion():
    with Diagram("d", rate=100) as diagram:
        Gain(name="assist")
    with pytest.raises(KeyError, match="d has no block 'asist': did you mean 'assist'"):
        diagram["asist"]


def test_diagrams_from_functions_report_the_line_in_the_function():
    def leg(side):
        with subsystem(side):
            return Sum("++")(Sine().y)

    with Diagram("d", rate=100) as diagram:
        leg("left"), leg("right")
    found = complaints(diagram)
    assert [(d.code, d.path, d.port) for d in found] == [("TW001", "left/sum", "u2"), ("TW001", "right/sum", "u2")]
    assert {d.where for d in found} == {type(found[0].where)(__file__, leg.__code__.co_firstlineno + 2)}


def test_a_subsystem_that_no_with_enters_is_reported():
    with Diagram("d", rate=100) as diagram:
        subsystem("left")
        Gain()(1.0)
        with subsystem("right"):
            Gain()(1.0)
    found = complaint(diagram)
    assert (found.code, found.where) == ("TW019", here(-5)) and "subsystem('left') contains no blocks" in found.message
