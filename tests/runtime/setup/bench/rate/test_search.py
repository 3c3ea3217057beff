"""Bisection comes as near as it is told, and stops where nothing passes."""

import pytest

from runtime.setup.bench.rate.search import Step, highest


def bus_of(limit):
    return lambda rate: Step(rate, 100, 0 if rate <= limit else 1)


@pytest.mark.parametrize("limit", [50.0, 51.0, 508.0, 4064.0, 8999.9])
def test_search_ends_within_the_resolution_below_the_limit(limit):
    rate, steps = highest(bus_of(limit), resolution=1.0)
    assert limit - 1.0 <= rate <= limit and len(steps) == 15


def test_with_the_papers_settings_the_search_takes_seven_steps():
    rate, steps = highest(bus_of(508.0))
    assert len(steps) == 8 and 408.0 <= rate <= 508.0


def test_a_bus_on_which_the_lowest_rate_fails_has_no_highest_rate():
    assert highest(bus_of(10.0)) == (0.0, [Step(50.0, 100, 1)])


def test_a_rate_step_passes_only_without_missed_replies_and_ticks():
    assert Step(100.0, 10, 0).passed and Step(100.0, 10, 0, lost=1, ticks=99).passed
    assert not Step(100.0, 10, 1).passed and not Step(100.0, 0, 0).passed
    assert not Step(100.0, 10, 0, lost=2, ticks=98).passed and not Step(100.0, 10, 0, why="silent").passed


def test_invalid_search_bounds_are_rejected():
    with pytest.raises(ValueError, match="expected 0 < low < high"):
        highest(bus_of(1.0), 100.0, 50.0)
