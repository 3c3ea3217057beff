"""Trigonometry against Python's, which is libm's too, and its ranges."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.trigonometry import Acos, Asin, Atan, Atan2, Cos, Sin, Tan
from graph import Interval
from tests.blocks.proofs import anything, keeps_its_range, sensible, ulps

FUNCTIONS = {Sin: math.sin, Cos: math.cos, Tan: math.tan, Asin: math.asin, Acos: math.acos, Atan: math.atan}
PI = math.pi


@pytest.mark.parametrize("kind", FUNCTIONS, ids=lambda kind: kind.__name__)
@given(u=anything | sensible | st.floats(-1.0, 1.0))
def test_each_function_is_within_two_ulp_of_python(kind, u):
    y = kind().step(u)
    try:
        assert ulps(y, FUNCTIONS[kind](u)) <= 2.0
    except ValueError:
        assert math.isnan(y)


@given(anything, anything)
def test_the_angle_of_a_point_is_that_of_python(opposite, adjacent):
    y = Atan2().step(opposite, adjacent)
    if math.isfinite(opposite) and math.isfinite(adjacent):
        assert ulps(y, math.atan2(opposite, adjacent)) <= 2.0
    else:
        assert math.isnan(y)


@pytest.mark.parametrize(
    "opposite, adjacent, wanted",
    [(1.0, 1.0, PI / 4), (1.0, -1.0, 3 * PI / 4), (-1.0, -1.0, -3 * PI / 4), (0.0, -2.0, PI), (0.0, 0.0, 0.0)],
)
def test_angles_in_all_four_quadrants(opposite, adjacent, wanted):
    assert Atan2().step(opposite, adjacent) == pytest.approx(wanted, rel=1e-15, abs=0.0)


@pytest.mark.parametrize("kind", FUNCTIONS, ids=lambda kind: kind.__name__)
def test_vectors_are_processed_elementwise_and_nan_affects_one_element(kind):
    y = kind().step(np.array([0.5, math.nan, -0.25]))
    assert [math.isnan(element) for element in y] == [False, True, False]
    assert y[2] == kind().step(-0.25)


@pytest.mark.parametrize("kind", [*FUNCTIONS, Atan2], ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_no_output_leaves_its_range(kind, data):
    keeps_its_range(data, kind(), nan=True)


@pytest.mark.parametrize("kind", [Sin, Cos, Tan], ids=lambda kind: kind.__name__)
@given(data=st.data(), quarter=st.integers(-50, 50), width=st.floats(0.0, 4.0))
def test_no_output_leaves_its_range_near_peaks_and_poles(kind, data, quarter, width):
    low = math.nextafter(quarter * PI / 2, data.draw(st.sampled_from([-math.inf, math.inf, 0.0])))
    u = Interval(low, low + width)
    found = kind().output_range(u)
    for value in (u.low, u.high, data.draw(st.floats(u.low, u.high))):
        assert kind().step(value) in found


@pytest.mark.parametrize(
    "block, inputs, wanted",
    [
        (Sin(), {"u": (0.1, 0.2)}, (math.sin(0.1), math.sin(0.2))),
        (Sin(), {"u": (1.0, 2.0)}, (math.sin(1.0), 1.0)),
        (Sin(), {"u": (4.0, 5.0)}, (-1.0, math.sin(4.0))),
        (Cos(), {"u": (-0.5, 0.25)}, (math.cos(0.5), 1.0)),
        (Cos(), {"u": (3.0, 3.5)}, (-1.0, math.cos(3.5))),
        (Tan(), {"u": (-1.0, 1.5)}, (math.tan(-1.0), math.tan(1.5))),
        (Tan(), {"u": (1.0, 2.0)}, (-math.inf, math.inf)),
        (Asin(), {"u": (-2.0, 0.5)}, (-PI / 2, math.asin(0.5))),
        (Acos(), {"u": (0.5, 7.0)}, (0.0, math.acos(0.5))),
        (Atan(), {"u": (-math.inf, 1.0)}, (-PI / 2, PI / 4)),
        (Atan2(), {"opposite": (-1.0, 1.0), "adjacent": (1.0, 2.0)}, (-PI / 4, PI / 4)),
        (Atan2(), {"opposite": (1.0, 2.0), "adjacent": (-2.0, -1.0)}, (math.atan2(2.0, -1.0), math.atan2(1.0, -2.0))),
        (Atan2(), {"opposite": (0.0, 1.0), "adjacent": (-1.0, 1.0)}, (-PI, PI)),
    ],
)
def test_ranges_are_tight_within_two_ulp(block, inputs, wanted):
    found = block.output_range(**{name: Interval(*ends) for name, ends in inputs.items()})
    assert found.low <= wanted[0] + 1e-15 and ulps(found.low, wanted[0]) <= 4.0
    assert found.high >= wanted[1] - 1e-15 and ulps(found.high, wanted[1]) <= 4.0
