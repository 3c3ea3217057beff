"""Bisection comes as near as it is told, and stops where nothing passes."""

import pytest

from runtime.bench.rate.search import Step, highest


def bus_of(limit):
    return lambda rate: Step(rate, 100, 0 if rate <= limit else 1)


@pytest.mark.parametrize("limit", [50.0, 51.0, 508.0, 4064.0, 8999.9])
def test_it_ends_less_than_a_resolution_below_the_limit(limit):
    rate, steps = highest(bus_of(limit), resolution=1.0)
    assert limit - 1.0 <= rate <= limit and len(steps) == 15


def test_with_the_papers_numbers_it_takes_seven_halvings():
    rate, steps = highest(bus_of(508.0))
    assert len(steps) == 8 and 408.0 <= rate <= 508.0


def test_a_bus_on_which_even_the_lowest_rate_fails_has_none():
    assert highest(bus_of(10.0)) == (0.0, [Step(50.0, 100, 1)])


def test_a_step_passes_only_where_everything_was_answered_and_the_loop_was_there():
    assert Step(100.0, 10, 0).passed and Step(100.0, 10, 0, lost=1, ticks=99).passed
    assert not Step(100.0, 10, 1).passed and not Step(100.0, 0, 0).passed
    assert not Step(100.0, 10, 0, lost=2, ticks=98).passed and not Step(100.0, 10, 0, why="silent").passed


def test_a_search_goes_up():
    with pytest.raises(ValueError, match="expected 0 < low < high"):
        highest(bus_of(1.0), 100.0, 50.0)
