"""Intervals hold whatever floating point makes of the numbers in them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from graph.interval import EVERYTHING, Interval

ends = st.floats(allow_nan=False)


@st.composite
def intervals_with_members(draw):
    low, high = sorted((draw(ends), draw(ends)))
    inside = draw(st.floats(min_value=low, max_value=high, allow_nan=False))
    return Interval(low, high), inside


def holds(interval, value):
    """A NaN is a fault at the actuator, so it may stand in any interval."""
    return math.isnan(value) or value in interval


@given(intervals_with_members(), intervals_with_members())
def test_intervals_contain_floating_point_sums_differences_and_products(first, second):
    (a, x), (b, y) = first, second
    assert holds(a + b, x + y)
    assert holds(a - b, x - y)
    assert holds(a * b, x * y)
    assert holds(-a, -x)
    assert holds(abs(a), abs(x))


@given(intervals_with_members(), intervals_with_members())
def test_a_union_holds_both_and_a_clip_into_an_interval_lands_in_the_intersection(first, second):
    (a, x), (b, y) = first, second
    assert x in a | b and y in a | b
    assert min(max(y, a.low), a.high) in a & b  # a clips what is in b
    assert a & b in a


def test_clipping_an_interval_outside_the_limits_gives_the_nearer_limit():
    assert Interval(-1.0, 1.0) & Interval(5.0, 6.0) == Interval.point(1.0)
    assert Interval(20.0, 30.0) & Interval(5.0, 6.0) == Interval.point(20.0)


def test_cancelling_infinities_give_an_unbounded_interval():
    assert Interval.point(math.inf) + EVERYTHING == EVERYTHING
    assert Interval.point(math.inf) - Interval.point(math.inf) == EVERYTHING
    assert Interval.point(0.0) * EVERYTHING == Interval.point(0.0)


def test_ends_are_rounded_outward():
    total = Interval.point(0.1) + Interval.point(0.2)
    assert total.low < 0.1 + 0.2 < total.high and total.high - total.low < 1e-15


def test_nan_gives_an_unbounded_interval_and_an_empty_one_is_rejected():
    assert Interval.point(math.nan) == EVERYTHING
    with pytest.raises(ValueError, match="an interval from 2.0 to 1.0 is empty"):
        Interval(2.0, 1.0)
    with pytest.raises(ValueError, match="empty"):
        Interval(math.nan, 1.0)


def test_an_interval_has_a_text_and_a_bounded_property():
    assert str(Interval(-12, 12.5)) == "[-12, 12.5]"
    assert Interval(-1, 1).bounded and not Interval(0.0).bounded and not EVERYTHING.bounded
    assert math.nan not in EVERYTHING and math.inf in EVERYTHING
