"""Units: one spelling, strict comparison, conversion only when asked."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from graph import Input, deg
from graph.units import canonical, convert, divide, multiply, parse, parse_quantity


@pytest.mark.parametrize(
    "spelling, unit",
    [
        ("N*m", "N·m"),
        ("Nm", "N·m"),
        ("m*N", "N·m"),
        ("N.m", "N·m"),
        ("m/s^2", "m/s²"),
        ("m/s**2", "m/s²"),
        ("m/s/s", "m/s²"),
        ("m·s^-2", "m/s²"),
        ("uT", "µT"),
        ("μT", "µT"),
        ("degC", "°C"),
        ("N*m/rad", "N·m/rad"),
        ("N*m*s/rad", "N·m·s/rad"),
        ("1", "1"),
        ("1/s", "1/s"),
        ("any", "any"),
        ("rad", "rad"),
        ("kg*m^2", "kg·m²"),
        ("m/m", "1"),
        (" rad / s ", "rad/s"),
        ("%", "%"),
        ("ohm", "Ω"),
        ("us", "µs"),
    ],
)
def test_accepted_spellings_are_stored_as_one(spelling, unit):
    assert canonical(spelling) == unit == canonical(unit)
    assert Input(spelling).unit == unit


@pytest.mark.parametrize("text", ["", "newton", "N m", "rad/", "/s", "3", "N*", "m^1.5", "*", "°F", None, 3])
def test_invalid_units_are_rejected(text):
    with pytest.raises((ValueError, TypeError), match="is not a unit|a unit is a string"):
        canonical(text)


def test_a_misspelt_unit_is_suggested():
    with pytest.raises(ValueError, match="'radd' in 'radd/s' is not a unit; did you mean 'rad'?"):
        canonical("radd/s")


symbols = st.sampled_from(["N", "m", "s", "rad", "A", "kg", "K", "V", "µT", "Ω"])
products = st.dictionaries(symbols, st.integers(-3, 3).filter(bool), min_size=1, max_size=4).map(
    lambda exponents: "·".join(f"{symbol}^{exponent}" for symbol, exponent in exponents.items())
)


@given(products, products)
def test_a_quotient_undoes_a_product(a, b):
    assert divide(multiply(a, b), b) == canonical(a)
    assert parse(canonical(a)) == parse(a)


def test_any_unit_is_not_part_of_a_product():
    assert multiply("any", "rad") == divide("rad", "any") == "any"


@pytest.mark.parametrize(
    "value, source, target, result",
    [
        (180.0, "deg", "rad", math.pi),
        (1.0, "rev", "deg", 360.0),
        (60.0, "rpm", "rev/s", 1.0),
        (25.0, "°C", "K", 298.15),
        (298.15, "K", "°C", 25.0),
        (1.0, "N·m", "J", 1.0),
        (1.0, "G", "µT", 100.0),
        (36.0, "km/h", "m/s", 10.0),
        (50.0, "%", "1", 0.5),
        (1.0, "Hz", "1/s", 1.0),
        (2.0, "rad", "rad", 2.0),
    ],
)
def test_values_convert_on_request(value, source, target, result):
    assert convert(value, source, target) == pytest.approx(result, rel=1e-12)


@pytest.mark.parametrize(
    "source, target", [("N·m", "rad"), ("rad", "1"), ("any", "rad"), ("rad", "any"), ("N·m/rad", "N·m")]
)
def test_units_of_different_dimensions_do_not_convert(source, target):
    with pytest.raises(ValueError, match="convert"):
        convert(1.0, source, target)


@pytest.mark.parametrize(
    "text, unit, value",
    [
        ("40", "N·m", 40.0),
        ("60 deg", "rad", math.pi / 3),
        ("60deg", "rad", math.pi / 3),
        ("-1e-3", "any", -1e-3),
        (".5 s", "s", 0.5),
        ("5.", "1", 5.0),
        ("inf", "N·m/s", math.inf),
        ("250 ms", "s", 0.25),
        ("60 deg", None, math.pi / 3),
        ("250 ms", None, 0.25),
        ("30 degC", None, 30.0),
        ("7", None, 7.0),
    ],
)
def test_quantities_are_converted_to_the_target_unit(text, unit, value):
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    "text, unit, complaint",
    [
        ("forty", "N·m", "'forty' is not a number"),
        ("", "1", "is not a number"),
        ("40 rad", "N·m", "rad does not convert to N·m"),
        ("1,5", "s", "is not a number: write a decimal point, as in 2.5"),
        ("60 deg", "any", "takes a number without a unit, got '60 deg'"),
        ("7 apples", None, "not a unit"),
        ("0x10", "1", "not a unit"),
    ],
)
def test_invalid_quantities_are_rejected(text, unit, complaint):
    with pytest.raises(ValueError, match=complaint):
        parse_quantity(text, unit)


def test_degrees_are_angles():
    assert deg(180.0) == math.pi
