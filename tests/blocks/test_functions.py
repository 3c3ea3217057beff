"""Functions of signals, beyond gain, sum and product: each against Python's own arithmetic, and its range."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.mathematics import Abs, Divide, Max, Min, Polynomial, Power, Round, Sign, SquareRoot, UnitConversion, power
from blocks.sources import Constant
from graph import Diagram, DiagramError, Interval, Live, compile, units
from tests.blocks.proofs import anything, finite, keeps_its_range, sensible, ulps

EVERYTHING = Interval()
ONE_INPUT = [
    Abs(),
    Sign(),
    SquareRoot(),
    Power(3.0),
    Polynomial((1.0, 2.0, 3.0)),
    UnitConversion("deg", "rad"),
    Round(),
]


@given(anything, anything)
def test_division_follows_ieee_754_but_division_by_infinity_is_nan(a, b):
    with np.errstate(all="ignore"):
        assert np.array_equal(Divide().step(a, b), math.nan if math.isinf(b) else np.divide(a, b), equal_nan=True)


def test_division_by_zero_is_infinite_or_nan():
    assert Divide().step(1.0, 0.0) == math.inf and Divide().step(1.0, -0.0) == -math.inf
    assert math.isnan(Divide().step(0.0, 0.0))


@given(anything)
def test_absolute_value_and_sign_equal_their_definition(u):
    assert Abs().step(u) == abs(u)
    sign = math.nan if math.isinf(u) else (u > 0.0) - (u < 0.0)  # 1 would hide the infinity
    assert np.array_equal(Sign().step(u), sign, equal_nan=True)


@given(st.lists(anything, min_size=5, max_size=5))
def test_min_and_max_of_five(values):
    infinite = any(map(math.isinf, values))  # the smallest of 0 and inf would clip the infinity
    assert np.array_equal(Min(5).step(*values), math.nan if infinite else min(values), equal_nan=True)
    assert np.array_equal(Max(5).step(*values), math.nan if infinite else max(values), equal_nan=True)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("kind", [Min, Max])
def test_a_nan_in_any_position_passes_min_and_max(kind, place):
    values = [1.0, 2.0, 3.0]
    values[place] = math.nan
    assert math.isnan(kind(3).step(*values))


def test_min_works_element_by_element_with_a_number_beside_a_vector():
    assert Min().step(np.array([1.0, 5.0, math.nan]), np.array([2.0, 2.0, 2.0])).tolist()[:2] == [1.0, 2.0]


@given(finite)
def test_the_square_root_is_rounded_correctly(u):
    if u < 0.0:
        assert math.isnan(SquareRoot().step(u))
    else:
        assert SquareRoot().step(u) == math.sqrt(u)


@given(anything, st.sampled_from([-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 2.5, 3.0]) | st.floats(-20.0, 20.0))
def test_a_power_is_that_of_libm_and_nan_for_a_root_of_a_negative_number(u, exponent):
    y = Power(exponent).step(u)
    if u < 0.0 and exponent % 1.0 or math.isinf(u) and exponent <= 0.0:
        assert math.isnan(y)  # inf to the -1 would be 0
    elif u == 0.0 and exponent < 0.0:
        assert math.isinf(y)
    else:
        assert ulps(y, power(u, exponent)) <= 2.0


@given(st.lists(sensible, min_size=1, max_size=6), sensible)
def test_a_polynomial_is_that_of_numpy(coefficients, u):
    wanted = 0.0
    for coefficient in coefficients:
        wanted = wanted * u + coefficient
    assert Polynomial(tuple(coefficients)).step(u) == wanted
    assert np.polyval(coefficients, u) == pytest.approx(wanted, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("block", ONE_INPUT, ids=lambda block: type(block).__name__)
def test_nan_passes_without_delay_and_is_not_stored(block):
    assert block.step(2.0) == block.step(2.0)
    assert math.isnan(block.step(math.nan))
    assert not math.isnan(block.step(2.0))


def test_a_constant_polynomial_and_a_power_of_zero_let_nan_pass():
    assert Polynomial((7.0,)).step(1.0) == 7.0 and math.isnan(Polynomial((7.0,)).step(math.nan))
    assert Power(0.0).step(5.0) == 1.0 and math.isnan(Power(0.0).step(math.nan))


@pytest.mark.parametrize(
    "method, wanted",
    [("nearest", [-2, -2, 0, 0, 2, 2, 3]), ("floor", [-3, -2, -1, 0, 1, 2, 2]), ("ceil", [-2, -1, 0, 1, 2, 3, 3])],
)
def test_rounding_follows_the_method(method, wanted):
    block = Round(method)
    assert [block.step(u) for u in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5, 2.75)] == wanted
    assert block.step(math.inf) == math.inf and math.isnan(block.step(math.nan))
    assert Round(method).step(np.array([1e300, math.inf])).tolist() == [1e300, math.inf]


@pytest.mark.parametrize(
    "source, target, u, wanted",
    [
        ("deg", "rad", 180.0, math.pi),
        ("rad", "deg", math.pi, 180.0),
        ("rpm", "rad/s", 60.0, 2.0 * math.pi),
        ("degC", "K", 20.0, 293.15),
        ("K", "degC", 0.0, -273.15),
        ("mm", "m", 5.0, 0.005),
        ("N*m", "J", 3.0, 3.0),
        ("%", "1", 50.0, 0.5),
    ],
)
def test_units_convert_within_two_ulp(source, target, u, wanted):
    assert ulps(UnitConversion(source, target).step(u), wanted) <= 2.0


@given(anything)
def test_a_conversion_is_one_multiplication_and_one_addition(u):
    factor, offset = units.conversion("degC", "K")
    assert UnitConversion("degC", "K").step(u) == factor * u + offset


def test_a_conversion_has_its_declared_units():
    with Diagram("d", rate=100) as diagram:
        angle = Constant(90.0, unit="deg", name="angle")()
        UnitConversion("deg", "rad", name="conversion")(angle)
        SquareRoot(name="root")(Power(2.0, name="square")(angle))
        Power(0.5, name="no_unit")(angle)
        Power(-1.0, name="inverse")(angle)
        Divide(name="ratio")(angle, angle)
    units_of = {path: place.unit for path, place in compile(diagram).signals.items()}
    assert units_of["conversion.y"] == "rad"
    assert units_of["square.y"] == "deg²" and units_of["root.y"] == "deg" and units_of["no_unit.y"] == "any"
    assert units_of["inverse.y"] == "1/deg" and units_of["ratio.y"] == "1"


def test_a_conversion_refuses_a_signal_in_another_unit():
    with Diagram("d", rate=100) as diagram:
        UnitConversion("deg", "rad")(Constant(1.0, unit="rad")())
    with pytest.raises(DiagramError, match="expected deg, got rad"):
        compile(diagram)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: UnitConversion("deg", "N*m"), "deg does not convert to N·m"),
        (lambda: UnitConversion("degs", "rad"), "'degs' is not a unit|did you mean"),
        (lambda: UnitConversion("deg"), "target is missing"),
        (lambda: Power(math.inf), "finite"),
        (lambda: Polynomial(()), "at least one"),
        (lambda: Polynomial((1.0, math.nan)), "finite"),
        (lambda: Polynomial(3.0), "all finite"),
        (lambda: Polynomial(unit="newton"), "not a unit"),
        (lambda: Min(1), "at least 2"),
        (lambda: Round("up"), "must be one of nearest, floor, ceil"),
    ],
)
def test_wrong_parameters_are_refused_where_the_block_is_made(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


@pytest.mark.parametrize("kind", [Abs, Sign, SquareRoot, Divide, Min, Max, Round], ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_no_output_leaves_its_range(kind, data):
    keeps_its_range(data, kind(), nan=True)


@given(data=st.data(), exponent=st.integers(-6, 6).map(float) | st.floats(-5.0, 5.0) | finite)
def test_a_power_stays_in_its_range(data, exponent):
    keeps_its_range(data, Power(exponent))


@given(data=st.data(), coefficients=st.lists(sensible | finite, min_size=1, max_size=6))
def test_a_polynomial_stays_in_its_range(data, coefficients):
    keeps_its_range(data, Polynomial(tuple(coefficients)))


@given(
    data=st.data(), pair=st.sampled_from([("deg", "rad"), ("degC", "K"), ("K", "degC"), ("h", "ms"), ("rpm", "rad/s")])
)
def test_a_conversion_covers_exactly_its_range(data, pair):
    keeps_its_range(data, UnitConversion(*pair))
    block = UnitConversion(*pair)
    low, high = sorted((data.draw(finite), data.draw(finite)))
    assert block.output_range(Interval(low, high)) == Interval(block.step(low), block.step(high))


@given(data=st.data(), count=st.integers(2, 12))
def test_min_and_max_of_many_stay_in_their_ranges(data, count):
    keeps_its_range(data, Min(count), shapes=((),))
    keeps_its_range(data, Max(count), shapes=((),))


@pytest.mark.parametrize(
    "block, inputs, wanted",
    [
        (Divide(), {"a": (1.0, 4.0), "b": (2.0, 8.0)}, (0.125, 2.0)),
        (Divide(), {"a": (-3.0, 4.0), "b": (-2.0, -1.0)}, (-4.0, 3.0)),
        (Divide(), {"a": (1.0, 2.0), "b": (0.0, 1.0)}, (-math.inf, math.inf)),
        (Abs(), {"u": (-3.0, 2.0)}, (0.0, 3.0)),
        (Sign(), {"u": (0.0, 2.0)}, (0.0, 1.0)),
        (SquareRoot(), {"u": (4.0, 9.0)}, (2.0, 3.0)),
        (SquareRoot(), {"u": (-4.0, 9.0)}, (0.0, 3.0)),
        (Min(), {"u1": (0.0, 5.0), "u2": (1.0, 2.0)}, (0.0, 2.0)),
        (Max(), {"u1": (0.0, 5.0), "u2": (1.0, 2.0)}, (1.0, 5.0)),
        (Round(), {"u": (0.4, 2.6)}, (0.0, 3.0)),
        (Power(0.0), {"u": (-1.0, 2.0)}, (1.0, 1.0)),
    ],
)
def test_ranges_are_tight(block, inputs, wanted):
    assert block.output_range(**{name: Interval(*ends) for name, ends in inputs.items()}) == Interval(*wanted)


@pytest.mark.parametrize(
    "exponent, ends, wanted",
    [
        (2.0, (-3.0, 2.0), (0.0, 9.0)),
        (3.0, (-3.0, 2.0), (-27.0, 8.0)),
        (-1.0, (2.0, 4.0), (0.25, 0.5)),
        (-2.0, (-2.0, 1.0), (0.25, math.inf)),
        (0.5, (-1.0, 4.0), (0.0, 2.0)),
        (-0.5, (0.0, 4.0), (0.5, math.inf)),
        (-1.0, (-1.0, 1.0), (-math.inf, math.inf)),
    ],
)
def test_ranges_of_powers_are_tight_within_two_ulp(exponent, ends, wanted):
    found = Power(exponent).output_range(Interval(*ends))
    assert ulps(found.low, wanted[0]) <= 2.0 and ulps(found.high, wanted[1]) <= 2.0


def test_a_live_exponent_proves_nothing():
    assert Power(Live(2.0, min=1.0, max=3.0)).output_range(Interval(0.0, 1.0)) == EVERYTHING


@pytest.mark.parametrize(
    "coefficients, ends, wanted",
    [
        ((1.0, 0.0, 0.0), (-2.0, 3.0), (0.0, 9.0)),
        ((1.0, 0.0, -1.0, 0.0), (-1.0, 1.0), (-2.0 / math.sqrt(27.0), 2.0 / math.sqrt(27.0))),
        ((-2.0, 4.0, 1.0), (0.0, 3.0), (-5.0, 3.0)),
    ],
)
def test_the_range_of_a_polynomial_is_tight_within_a_hundredth(coefficients, ends, wanted):
    found = Polynomial(coefficients).output_range(Interval(*ends))
    slack = 0.01 * (wanted[1] - wanted[0])
    assert wanted[0] - slack <= found.low <= wanted[0] and wanted[1] <= found.high <= wanted[1] + slack


def test_a_square_is_not_negative_for_an_unbounded_input_either():
    assert Polynomial((1.0, 0.0, 0.0)).output_range(EVERYTHING) == Interval(0.0, math.inf)
