"""Operators on signals make blocks, and their units are checked like any other's."""

import numpy as np
import pytest

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Constant, Ramp
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Output, compile, stack
from tests.graph.complaints import complaint, here


class Gyro(Block):
    """A rate about three axes."""

    rate = Output("rad/s", "rate", shape=(3,))

    def step(self, t):
        return np.array([t, 10.0 * t, -t])


def last(diagram, ticks=3):
    """Signals of the last of some ticks, and units, by path."""
    with diagram:
        CsvRecorder()
    schedule = compile(diagram)
    shared = SharedState(1 << 20)
    assert Executor(Program(schedule), diagram.rate, shared=shared, virtual=True).run(ticks).status == "ok"
    row = [np.frombuffer(payload) for kind, payload in shared.drain() if kind == RECORD_ROW][-1]
    return {c.path: row[2 + c.index] for c in schedule.sinks[0].columns}, {
        path: place.unit for path, place in schedule.signals.items()
    }


def test_every_operator_computes_its_equation():
    with Diagram("d", rate=10) as diagram:
        a, b = Ramp(slope=5.0, name="a")(), Constant(8.0, name="b")()
        made = [2.0 * a - b, a + 1, 1 - a, a * b, b / a, -b, b / 4, 3.0 / b, a * 2, b - a + b]
    values, _ = last(diagram)
    expected = [-6.0, 2.0, 0.0, 8.0, 8.0, -8.0, 2.0, 0.375, 2.0, 15.0]
    assert [values[signal.path] for signal in made] == expected


def test_elements_slices_and_stacks_have_their_values():
    with Diagram("d", rate=10) as diagram:
        rate = Gyro()()
        one, two, back = rate[1], rate[:2], stack(rate[2], rate[0], 7.0)
    values, units = last(diagram)
    assert values[one.path] == 2.0 and [values[f"{two.path}[{i}]"] for i in (0, 1)] == [0.2, 2.0]
    assert [values[f"{back.path}[{i}]"] for i in range(3)] == [-0.2, 0.2, 7.0]
    assert units[one.path] == units[two.path] == units[back.path] == "rad/s"


def test_units_are_multiplied_divided_and_converted():
    with Diagram("d", rate=10) as diagram:
        torque, rate = Constant(3.0, unit="N·m", name="torque")(), Constant(2.0, unit="rad/s", name="rate")()
        power, ratio, degrees = torque * rate, torque / rate, (rate + rate).to("deg/s")
    values, units = last(diagram)
    assert units[power.path] == "N·m·rad/s" and units[ratio.path] == "N·m·s/rad" and units[degrees.path] == "deg/s"
    assert values[degrees.path] == pytest.approx(229.1831180523293, rel=1e-15)


def test_a_sum_of_different_units_is_a_mismatch_at_the_users_line():
    with Diagram("d", rate=10) as diagram:
        torque, rate = Constant(3.0, unit="N·m", name="torque")(), Constant(2.0, unit="rad/s", name="rate")()
        torque + rate
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.where) == ("TW002", at) and "N·m" in found.message and "rad/s" in found.message


def test_a_conversion_to_another_dimension_is_rejected_at_its_line():
    with Diagram("d", rate=10) as diagram:
        Constant(3.0, unit="N·m", name="torque")().to("rad")
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.where) == ("TW010", at) and "N·m does not convert to rad" in found.message


def test_a_signal_is_neither_a_truth_nor_a_sequence_nor_divided_by_zero():
    with Diagram("d", rate=10):
        signal = Constant(1.0)()
        with pytest.raises(TypeError, match="has no value until the diagram runs"):
            bool(signal)
        with pytest.raises(TypeError):
            list(signal)
        with pytest.raises(ZeroDivisionError):
            signal / 0
        with pytest.raises(TypeError, match="is a scalar, which has no elements"):
            signal[:1]
        with pytest.raises(TypeError, match="require a declared shape"):
            Gain()(signal)[:1]
