"""Blocks that remember."""

import math

import numpy as np
import pytest

from blocks.discrete import UnitDelay
from blocks.mathematics import Gain, Sum
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.running import both_ways, player, run


@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
def test_a_unit_delay_returns_the_input_of_the_previous_tick(shape):
    u = np.random.default_rng(8).normal(size=(20, *shape))
    y = both_ways(lambda: UnitDelay(initial=-4.0), u=u)["y"]
    assert np.array_equal(y[1:], u[:-1]) and np.all(y[0] == -4.0)


def test_a_delay_returns_nan_one_tick_later_and_no_longer():
    y = both_ways(UnitDelay, u=np.array([1.0, math.nan, 2.0, 3.0]))["y"]
    assert np.array_equal(y, [0.0, 1.0, math.nan, 2.0], equal_nan=True)


def test_a_delay_closes_a_loop_that_counts():
    with Diagram("counter", rate=100) as diagram:
        delay = UnitDelay(initial=10.0, name="delay")
        total = Sum("++", name="total")
        delay(total(delay.y, player([1.0])))
    assert run(diagram, 5)["total.y"].tolist() == [11.0, 12.0, 13.0, 14.0, 15.0]
    assert run(diagram, 5)["delay.y"].tolist() == [10.0, 11.0, 12.0, 13.0, 14.0], "and starts over in the next run"


def test_a_chain_of_delays_has_its_length_in_any_order_of_construction():
    with Diagram("chain", rate=100) as diagram:
        last, first, middle = UnitDelay(name="a"), UnitDelay(name="b"), UnitDelay(name="c")
        last(middle.y)
        middle(first.y)
        first(player(np.arange(1.0, 9.0)))
    assert run(diagram, 8)["a.y"].tolist() == [0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_loop_without_a_delay_does_not_compile():
    with Diagram("loop", rate=100) as diagram:
        total = Sum("++", name="total")
        total(Gain(0.5, name="half")(total.y), player([1.0]))
    with pytest.raises(DiagramError, match="UnitDelay"):
        compile(diagram)


def test_the_range_of_a_delay_contains_its_input_and_initial_value():
    assert UnitDelay(initial=5.0).output_range(u=Interval(-1.0, 1.0)) == Interval(-1.0, 5.0)


def test_after_a_reset_a_delay_begins_again():
    delay = UnitDelay(initial=1.0)
    delay.step(7.0)
    delay.update(7.0)
    assert delay.step(8.0) == 7.0
    delay.reset()
    assert delay.step(8.0) == 1.0


@pytest.mark.parametrize("initial", [math.nan, "0", [0.0, 1.0]])
def test_nan_initial_value_is_refused(initial):
    with pytest.raises(DiagramError, match="UnitDelay: initial: "):
        UnitDelay(initial=initial)
