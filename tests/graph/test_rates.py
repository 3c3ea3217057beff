"""Rates and conditions: slow subsystems, subsystems that hold, and what may not meet."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.discrete import Hold, UnitDelay
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.logic import Switch
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine, StepSource
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Interval, Output, Signal, compile, subsystem
from graph.compilation import Compilation
from graph.compiler import examine, prove, sort
from graph.rate_checks import check_rates
from graph.type_checks import check_shapes
from graph.wire_checks import check_wires
from tests.graph.complaints import complaint, here, refusal


class Counter(Block):
    """How often it ran, and the dt it saw."""

    u = Input("any", "only there to be wired")
    count = Output("1", "runs")
    seen = Output("s", "dt")

    def reset(self):
        self.runs = 0

    def step(self, u, dt):
        self.runs += 1
        return self.runs, dt


def trace(diagram, ticks):
    """Rows of a run as a dict of arrays by signal path."""
    with diagram:
        CsvRecorder()
    schedule = compile(diagram)
    shared = SharedState(1 << 20)
    assert Executor(Program(schedule), diagram.rate, shared=shared, virtual=True).run(ticks).status == "ok"
    rows = np.array([np.frombuffer(payload) for kind, payload in shared.drain() if kind == RECORD_ROW])
    return {column.path: rows[:, 2 + column.index] for column in schedule.sinks[0].columns}


def test_a_slow_subsystem_runs_at_every_nth_tick_and_holds_in_between():
    with Diagram("d", rate=100) as diagram:
        wave = Sine(1.0, 3.0)()
        with subsystem("slow", every=4):
            Gain(2.0)(wave)
    signals = trace(diagram, 20)
    assert np.array_equal(signals["slow/gain.y"], np.repeat(2.0 * signals["sine.y"][::4], 4))


def test_a_slow_block_sees_its_own_period():
    with Diagram("d", rate=100) as diagram:
        Counter(every=5, name="counter")(Sine()())
        with subsystem("slow", every=5):
            SlewRate(rate=1.0)(10.0)
    signals = trace(diagram, 12)
    assert signals["counter.count"].tolist() == [1] * 5 + [2] * 5 + [3] * 2
    assert np.all(signals["counter.seen"] == 0.05)
    assert signals["slow/slew_rate.y"][[0, 5, 10]] == pytest.approx([0.05, 0.1, 0.15], abs=1e-13)


def test_nested_subsystems_multiply_their_rates():
    with Diagram("d", rate=100), subsystem("a", every=2), subsystem("b", every=3):
        assert Gain(every=2).every == 12


def test_the_schedule_lists_the_rate_transitions():
    with Diagram("d", rate=100) as diagram:
        with subsystem("slow", every=4):
            slow = Gain()(Sine()())
        Gain(name="fast")(slow)
    assert compile(diagram).holds == [("slow/gain.y", 4, "fast.u", 1)]


def test_rates_that_do_not_divide_are_refused():
    with Diagram("d", rate=100) as diagram:
        two = Gain(every=2, name="two")(Sine(every=2)())
        Gain(every=3, name="three")(two)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW014", "three", "u", at)
    assert (
        "every 3 ticks" in found.message
        and "two.y at every 2" in found.message
        and found.hint == "insert a Hold(every=3), which samples the signal"
    )


def test_a_device_runs_at_every_tick():
    with Diagram("d", rate=100) as diagram, subsystem("slow", every=2):
        CubeMars("AK80-9")(torque_command=0.0)
    assert complaint(diagram).code == "TW014"


@pytest.mark.parametrize("every", [0, -1, 1.5, "2", None])
def test_every_is_an_integer_number_of_ticks(every):
    with Diagram("d", rate=100):
        assert refusal(subsystem, "slow", every=every).code == "TW014"
        assert refusal(Gain, every=every).code == "TW014"


@pytest.mark.parametrize("before, own, after", [(2, 3, 3), (3, 2, 2), (5, 3, 6), (4, 1, 3), (3, 5, 2), (1, 7, 3)])
def test_a_hold_samples_at_its_own_ticks_where_rates_do_not_divide(before, own, after):
    with Diagram("d", rate=100) as diagram:
        wave = Sine(1.0, 3.0, every=before)()
        Gain(2.0, every=after, name="after")(Hold(every=own, name="hold")(wave))
    signals = trace(diagram, 60)

    def at(ticks, values):  # plain Python: the last tick that a rate of every so many has run at
        return [values[tick - tick % ticks] for tick in range(60)]

    wave = at(before, [math.sin(2.0 * math.pi * 3.0 * tick / 100.0) for tick in range(60)])
    held = at(own, wave)
    assert signals["hold.y"] == pytest.approx(held, abs=1e-13)
    assert signals["after.y"] == pytest.approx([2.0 * value for value in at(after, held)], abs=1e-13)
    schedule = compile(diagram)
    assert ("sine.y", before, "hold.u", own) in schedule.holds or before == own


def test_a_hold_is_bounded_as_its_input_is():
    with Diagram("d", rate=100) as diagram:
        hold = Hold(every=3)
        hold(Saturation(-2.0, 5.0, every=2)(Sine(9.0)()))
    compilation = examine(diagram)
    assert not compilation.errors and compilation.ranges[hold.y] == Interval(-2.0, 5.0)


def test_a_disabled_subsystem_holds_outputs_and_states():
    with Diagram("d", rate=100) as diagram:
        enabled = StepSource(0.0, 1.0, 0.05)()
        wave = Sine(1.0, 3.0)()
        with subsystem("assist", enabled=enabled):
            UnitDelay()(Gain(3.0)(wave))
    signals = trace(diagram, 12)
    wave = signals["sine.y"]
    assert np.array_equal(signals["assist/gain.y"], np.where(np.arange(12) < 5, 0.0, 3.0 * wave))
    assert np.array_equal(signals["assist/unit_delay.y"][:7], [0, 0, 0, 0, 0, 0, 3.0 * wave[5]])


def test_a_condition_that_is_nan_disables():
    class Nan(Block):
        """NaN."""

        y = Output("any")

        def step(self):
            return float("nan")

    with Diagram("d", rate=100) as diagram, subsystem("assist", enabled=Nan()()):
        Gain(name="held")(StepSource(1.0, 1.0)())
    assert not trace(diagram, 3)["assist/held.y"].any()


def test_the_range_of_a_slow_block_contains_its_initial_zero():
    with Diagram("d", rate=100) as diagram, subsystem("assist", enabled=StepSource()()):
        held = Gain()(StepSource(5.0, 6.0)())
    compilation = Compilation(diagram)
    for check in (check_wires, check_shapes, check_rates, sort, prove):
        check(compilation)
    assert compilation.ranges[Signal(held.block, "y")] == Interval(0.0, 6.0)


def test_a_command_that_may_be_held_causes_a_warning():
    with Diagram("d", rate=100) as diagram:
        with subsystem("assist", enabled=StepSource()()):
            torque = TorqueLimiter(limit=5.0)(1.0)
        CubeMars("AK80-9", name="knee")(torque_command=torque)
        at = here(-1)
    (warning,) = [w for w in compile(diagram).warnings if w.code == "TW021"]
    assert (warning.path, warning.port, warning.where) == (
        "knee",
        "torque_command",
        at,
    ) and "while step_source.y is false" in warning.message


def test_a_held_command_behind_a_limiter_causes_the_warning_and_a_switch_does_not():
    def warnings(selected):
        with Diagram("d", rate=100) as diagram:
            enabled = StepSource()()
            with subsystem("assist", enabled=enabled):
                torque = Gain(3.0, name="torque")(1.0)
            torque = Switch()(condition=enabled, a=torque, b=0.0) if selected else Gain(2.0)(torque)
            CubeMars("AK80-9", name="knee")(torque_command=TorqueLimiter(limit=5.0)(torque))
        return [warning.message for warning in compile(diagram).warnings if warning.code == "TW021"]

    assert warnings(selected=False) == ["assist/torque.y keeps its last value while step_source.y is false"]
    assert warnings(selected=True) == []


def test_a_loop_behind_a_command_is_no_held_command():
    with Diagram("d", rate=100) as diagram:
        delay = UnitDelay()
        delay(Gain(0.5)(delay.y))
        CubeMars("AK80-9", name="knee")(torque_command=TorqueLimiter(limit=5.0)(delay.y))
    assert not [warning for warning in compile(diagram).warnings if warning.code == "TW021"]


def test_a_condition_is_a_scalar_signal():
    with Diagram("d", rate=100):
        assert refusal(subsystem, "assist", enabled=1.0).code == "TW012"


def test_a_condition_that_depends_on_its_own_subsystem_is_a_loop():
    with Diagram("d", rate=100) as diagram:
        source = Gain(name="condition")
        with subsystem("assist", enabled=source.y):
            inside = Gain(name="inside")(1.0)
        source(inside)
    found = complaint(diagram)
    assert (
        found.code == "TW006"
        and "assist/inside.y -> condition.u" in found.message
        and ("condition.y -> assist/inside.enabled") in found.message
    )
