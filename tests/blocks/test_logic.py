"""Logic: truth tables, edges, memory of bools, time, and choosing between signals. NaN is neither true nor false and
passes.
"""

import itertools
import math
import operator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.logic import And, Compare, Counter, Debounce, Edge, Latch, Not, Or, Selector, Switch, Timer, Xor
from blocks.sources import Constant, Pulse, Ramp, TimeTable
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.proofs import anything, keeps_its_range, sensible
from tests.blocks.running import run

NAN = math.nan
RELATIONS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


def same(found, wanted):
    return np.array_equal(np.array(found, dtype=float), np.array(wanted, dtype=float), equal_nan=True)


def steps(block, *signals):
    """What a block gives for each sample of its inputs in turn."""
    return [block.step(*values) for values in zip(*signals)]


@pytest.mark.parametrize("relation", RELATIONS)
@given(a=anything | st.integers(-2, 2).map(float), b=anything | st.integers(-2, 2).map(float))
def test_a_comparison_equals_pythons(relation, a, b):
    assert Compare(relation).step(a, b) is RELATIONS[relation](a, b)


@pytest.mark.parametrize("relation", RELATIONS)
def test_a_comparison_with_nan_is_nan(relation):
    assert same([Compare(relation).step(NAN, 1.0), Compare(relation).step(1.0, NAN)], [NAN, NAN])


def test_comparison_is_elementwise_for_any_unit():
    assert same(Compare(">=").step(np.array([1.0, 2.0, NAN]), np.array([2.0, 2.0, 2.0])), [0, 1, NAN])
    with Diagram("d", rate=100) as diagram:
        Compare(">", name="flexed")(Ramp(100.0, unit="deg")(), 2.5)
    assert run(diagram, 5)["flexed.y"].tolist() == [0.0, 0.0, 0.0, 1.0, 1.0]
    assert compile(diagram).signals["flexed.y"].dtype == "bool" and compile(diagram).signals["flexed.y"].unit == "1"


def test_a_comparison_of_different_units_does_not_compile():
    with Diagram("d", rate=100) as diagram:
        Compare(">")(Constant(1.0, unit="deg")(), Constant(1.0, unit="rad")())
    with pytest.raises(DiagramError, match="expected (deg|rad), got (rad|deg)"):
        compile(diagram)


@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("kind, rule", [(And, all), (Or, any), (Xor, lambda values: sum(values) % 2 == 1)])
def test_logic_blocks_follow_their_truth_tables(kind, rule, count):
    for values in itertools.product((False, True), repeat=count):
        assert kind(count).step(*values) is rule(values)


@pytest.mark.parametrize("kind", [And, Or, Xor])
@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("others", [0.0, 1.0])
def test_a_nan_in_any_position_passes(kind, place, others):
    values = [others] * 3
    values[place] = NAN
    assert math.isnan(kind(3).step(*values))


def test_logical_not():
    assert Not().step(True) is False and Not().step(False) is True and math.isnan(Not().step(NAN))


def test_a_torque_cannot_be_connected_to_a_bool():
    with Diagram("d", rate=100) as diagram:
        Not()(Constant(1.0, unit="N·m")())
    with pytest.raises(DiagramError, match="expected 1, got N·m"):
        compile(diagram)


SIGNAL = [1, 1, 0, 0, 1, NAN, 1, NAN, 0, 0]


@pytest.mark.parametrize(
    "kind, wanted",
    [
        ("rising", [0, 0, 0, 0, 1, NAN, 0, NAN, 0, 0]),
        ("falling", [0, 0, 1, 0, 0, NAN, 0, NAN, 1, 0]),
        ("both", [0, 0, 1, 0, 1, NAN, 0, NAN, 1, 0]),
    ],
)
def test_edges_last_one_tick_and_nan_is_not_stored(kind, wanted):
    assert same(steps(Edge(kind), SIGNAL), wanted)


def test_first_sample_is_never_an_edge():
    assert Edge().step(True) is False and Edge("falling").step(False) is False


def test_anything_but_zero_is_true():
    assert same(steps(Edge("both"), [0.0, 1.0, 2.0, -0.5, math.inf, -0.0]), [0, 1, 0, 0, 0, 1])
    assert And().step(2.0, -1.0) is True and Xor().step(2.0, 1.0) is False and Not().step(0.5) is False
    assert Debounce(0.0).step(3.0) is True and Latch().step(7.0, 0.0) is True


def test_a_latch_holds_and_off_has_priority():
    on = [0, 1, 0, 0, 1, 1, 0, NAN, 0, 0]
    off = [0, 0, 0, 1, 0, 1, 0, 0, NAN, 0]
    assert same(steps(Latch(), on, off), [0, 1, 1, 0, 1, 0, 0, NAN, NAN, 0])
    assert same(steps(Latch(True), [0, 0, 0], [0, 1, 0]), [1, 0, 0])


def test_a_latch_without_off_stays_on():
    latch = Latch()
    assert [latch.step(on) for on in (False, True, False)] == [False, True, True]


def debounced(u, ticks):
    """Reference: the value that has lasted for `ticks` periods, by counting samples."""
    held, wait, found = u[0], 0, []
    for now in u:
        wait = wait + 1 if now != held else 0
        if wait > ticks:
            held, wait = now, 0
        found.append(held)
    return found


@given(
    u=st.lists(st.booleans(), min_size=1, max_size=60),
    ticks=st.integers(0, 7),
    rate=st.sampled_from([10.0, 200.0, 300.0, 1000.0]),
)
def test_pulse_shorter_than_debounce_time_is_suppressed(u, ticks, rate):
    block = Debounce(ticks / rate)
    block.dt = 1.0 / rate
    assert steps(block, u) == debounced(u, ticks)


def test_nan_restarts_the_wait_of_a_debounce():
    block = Debounce(0.2)
    block.dt = 0.1
    assert same(steps(block, [0, 1, 1, NAN, 1, 1, 1, 1]), [0, 0, 0, NAN, 0, 0, 1, 1])


def test_a_debounce_is_exact_to_the_tick_after_hours():
    with Diagram("d", rate=1000) as diagram:
        bouncing = TimeTable((0.0, 3.0, 3.005, 3.1), (0.0, 1.0, 0.0, 1.0), interpolation="previous", unit="1")()
        Debounce(0.05, name="settled")(Compare(">", name="raw")(bouncing, 0.5))
    y = run(diagram, 3300)["settled.y"]
    assert np.flatnonzero(np.diff(y)).tolist() == [3149], "true from 3.100 s on, so settled at 3.150 s"
    late = Debounce(0.003)
    late.dt = 0.001
    late.step(False)
    late.scratch.tick = 10**8
    assert [late.step(True) for _ in range(4)] == [False, False, False, True]


def test_a_counter_counts_rising_edges_and_clear_wins():
    u = [1, 0, 1, 1, 0, 1, NAN, 1, 0, 1, 0, 1]
    clear = [0, 0, 0, 0, 0, 0, 0, 0, 0, 1, NAN, 0]
    assert same(steps(Counter(), u, clear), [0, 0, 1, 1, 1, 2, NAN, 2, 2, 0, NAN, 1])


def test_a_selector_accepts_the_integer_of_a_counter():
    with Diagram("d", rate=10) as diagram:
        pulse = Compare(">")(Pulse(period=0.4)(), 0.5)
        Selector(3, name="chosen")(Counter(name="counter")(pulse), 10.0, 20.0, 30.0)
    recording = run(diagram, 14)
    assert recording["counter.count"].tolist() == [0] * 4 + [1] * 4 + [2] * 4 + [3] * 2
    assert same(recording["chosen.y"], [10] * 4 + [20] * 4 + [30] * 4 + [NAN] * 2)


def test_timer_outputs_time_since_restart():
    with Diagram("d", rate=200) as diagram:
        Timer(name="timer")(Compare(">")(TimeTable((0.0, 0.1, 0.15), (0.0, 1.0, 0.0), interpolation="previous")(), 0.5))
        Timer(name="run")
    recording = run(diagram, 200)
    t = np.arange(200) / 200.0
    assert np.array_equal(recording["run.elapsed"], t)
    assert recording["timer.elapsed"] == pytest.approx(
        np.where(t < 0.0999, t, np.maximum(0.0, t - 29 / 200)), abs=1e-12
    )


def test_a_nan_stops_no_timer():
    block = Timer()
    block.dt = 0.5
    assert same(steps(block, [0, NAN, 0, 1, NAN, 0]), [0.0, NAN, 1.0, 0.0, NAN, 1.0])


def test_a_switch_shows_the_nan_of_the_one_that_is_chosen_only():
    switch = Switch()
    assert switch.step(True, 1.0, NAN) == 1.0 and switch.step(False, NAN, 2.0) == 2.0
    assert math.isnan(switch.step(False, 1.0, NAN)) and math.isnan(switch.step(NAN, 1.0, 1.0))
    assert Switch().step(True, np.array([1.0, 2.0]), np.array([3.0, 4.0])).tolist() == [1.0, 2.0]


def test_a_selector_counts_from_zero_and_is_nan_out_of_range():
    block = Selector(3)
    assert [block.step(index, 10.0, 11.0, 12.0) for index in (0, 1, 2, 1.75)] == [10.0, 11.0, 12.0, 11.0]
    for index in (-1, 3, 1e300, -math.inf, math.inf, NAN):
        assert math.isnan(block.step(index, 10.0, 11.0, 12.0))
    assert block.step(0, 10.0, NAN, NAN) == 10.0


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: Compare("=>"), "must be one of <, <=, >, >=, ==, !="),
        (lambda: And(1), "at least 2"),
        (lambda: Edge("up"), "must be one of rising"),
        (lambda: Debounce(-1.0), "at least 0.0 s"),
        (lambda: Selector(1), "at least 2"),
        (lambda: Latch(1.0), "expected True or False"),
    ],
)
def test_wrong_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


BLOCKS = {
    "And": st.builds(And, st.integers(2, 5)),
    "Or": st.builds(Or, st.integers(2, 5)),
    "Xor": st.builds(Xor, st.integers(2, 5)),
    "Not": st.builds(Not),
    "Compare": st.builds(Compare, st.sampled_from(list(RELATIONS))),
    "Edge": st.builds(Edge, st.sampled_from(["rising", "falling", "both"])),
    "Latch": st.builds(Latch, st.booleans()),
    "Debounce": st.builds(Debounce, st.floats(0.0, 0.005)),
    "Counter": st.builds(Counter),
    "Timer": st.builds(Timer),
    "Switch": st.builds(Switch),
    "Selector": st.builds(Selector, st.integers(2, 6)),
}


@pytest.mark.parametrize("kind", BLOCKS)
@given(data=st.data())
def test_no_output_leaves_its_range(kind, data):
    keeps_its_range(
        data, data.draw(BLOCKS[kind]), nan=True, ticks=6, numbers=anything | sensible | st.integers(-2, 2).map(float)
    )


FALSE, TRUE, EITHER = Interval(0.0, 0.0), Interval(1.0, 1.0), Interval(0.0, 1.0)


@pytest.mark.parametrize(
    "block, inputs, wanted",
    [
        (Compare("<"), {"a": Interval(0, 1), "b": Interval(2, 3)}, TRUE),
        (Compare("<"), {"a": Interval(3, 4), "b": Interval(2, 3)}, FALSE),
        (Compare("<="), {"a": Interval(3, 4), "b": Interval(2, 3)}, EITHER),
        (Compare(">="), {"a": Interval(3, 4), "b": Interval(2, 3)}, TRUE),
        (Compare("=="), {"a": Interval(3, 3), "b": Interval(3, 3)}, TRUE),
        (Compare("!="), {"a": Interval(0, 1), "b": Interval(2, 3)}, TRUE),
        (And(), {"u1": EITHER, "u2": FALSE}, FALSE),
        (And(), {"u1": TRUE, "u2": TRUE}, TRUE),
        (Or(), {"u1": EITHER, "u2": TRUE}, TRUE),
        (Xor(), {"u1": TRUE, "u2": TRUE}, FALSE),
        (Not(), {"u": FALSE}, TRUE),
        (Edge(), {"u": TRUE}, FALSE),
        (Latch(), {"on": FALSE, "off": EITHER}, FALSE),
        (Latch(), {"on": TRUE, "off": FALSE}, TRUE),
        (Latch(True), {"on": FALSE, "off": FALSE}, TRUE),
        (Debounce(), {"u": TRUE}, TRUE),
        (Counter(), {"u": EITHER, "clear": TRUE}, FALSE),
        (Timer(), {"restart": TRUE}, FALSE),
        (Switch(), {"condition": TRUE, "a": Interval(1, 2), "b": Interval(5, 6)}, Interval(1, 2)),
        (Switch(), {"condition": EITHER, "a": Interval(1, 2), "b": Interval(5, 6)}, Interval(1, 6)),
        (Selector(2), {"index": Interval(1.5, 1.5), "u0": Interval(0, 9), "u1": Interval(1, 2)}, Interval(1, 2)),
        (Selector(2), {"index": Interval(0.5, 0.75), "u0": Interval(0, 9), "u1": Interval(1, 2)}, Interval(0, 9)),
        (
            Selector(3),
            {"index": Interval(1, 2), "u0": Interval(-9, 9), "u1": Interval(1, 2), "u2": Interval(3, 4)},
            Interval(1, 4),
        ),
    ],
)
def test_ranges_are_tight(block, inputs, wanted):
    assert block.output_range(**inputs) == wanted
