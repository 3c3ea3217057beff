"""The grid: whole nanoseconds that never drift, and the grid point that is due."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cext.clock.deadline_clock import DeadlineClock
from cext.clock.signals import Signals

pytestmark = pytest.mark.timing

TICKS = [0, 1, 2, 3, 999, 10**6, 10**9, 10**9 + 1]


def pace(rate):
    return DeadlineClock(rate, Signals())


@pytest.mark.parametrize("rate", ["200", "1000", "3000", "0.7", "333.3", "142.85714285714286", "44100", "1e5", "0.001"])
def test_k_grid_points_take_k_periods_to_the_nanosecond(rate):
    grid = pace(float(rate)).grid
    for tick in [*TICKS, 5 * 86400 * 10**5]:  # the last: five days at 1e5 Hz
        exact = tick * 10**9 / Fraction(rate)
        if exact < 2**62:
            assert abs(grid(tick) - exact) <= Fraction(1, 2) + Fraction(1, 1000)


def test_three_thousand_hertz_lands_on_every_second_for_ten_years():
    grid = pace(3000.0).grid
    assert all(grid(3000 * second) == second * 10**9 for second in (1, 3, 10**4, 10 * 365 * 86400))
    assert [grid(tick) for tick in range(4)] == [0, 333333, 666667, 1000000]


@given(rate=st.floats(1e-3, 1e6), tick=st.integers(0, 10**9), off=st.integers(-3, 3))
def test_the_newest_grid_point_is_the_last_one_that_is_not_in_the_future(rate, tick, off):
    clock = pace(rate)
    now = max(0, clock.grid(tick) + off)
    found = clock.newest(now)
    assert clock.grid(found) <= now < clock.grid(found + 1)


def test_a_rate_beyond_the_clock_is_refused():
    with pytest.raises(ValueError, match="exceeds the range of the clock"):
        pace(1e-11)
    with pytest.raises(ValueError, match="0 ns or more"):
        DeadlineClock(100.0, Signals(), spin=-1)
