"""Arithmetic against NumPy, to the bit where only one operation is made."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.mathematics import Gain, Product, Sum
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.running import both_ways, player, run

anything = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(-1e9, 1e9)


@given(gain=finite, u=st.lists(anything, min_size=3, max_size=3))
def test_a_gain_multiplies_each_element(gain, u):
    with np.errstate(all="ignore"):
        assert np.array_equal(Gain(gain).step(np.array(u)), gain * np.array(u), equal_nan=True)
    assert np.array_equal(Gain(gain).step(u[0]), gain * u[0], equal_nan=True)


@pytest.mark.parametrize("shape", [(), (3,), (4,), (2, 3)])
def test_a_gain_keeps_the_shape_of_its_input(shape):
    u = np.random.default_rng(7).normal(size=(10, *shape))
    assert np.array_equal(both_ways(lambda: Gain(-2.5), u=u)["y"], -2.5 * u)


def test_the_unit_of_a_gain_multiplies_that_of_its_input():
    with Diagram("units", rate=100) as diagram:
        Gain(30.0, unit="N*m/rad", name="spring")(player([1.0], "rad"))
        Gain(2.0, name="plain")(player([1.0], "rad"))
    schedule = compile(diagram)
    assert schedule.signals["spring.y"].unit == "N·m" and schedule.signals["plain.y"].unit == "rad"


def test_gain_with_invalid_unit_is_refused_at_construction():
    with pytest.raises(DiagramError, match="gain: 'newton' is not a unit"):
        Gain(2.0, unit="newton")


@pytest.mark.parametrize(
    "value, said", [(math.nan, "NaN is not allowed"), ("2", "expected a number"), ([1.0, 2.0], "expected one number")]
)
def test_nan_gain_is_refused(value, said):
    with pytest.raises(DiagramError, match=f"Gain: gain: {said}"):
        Gain(value)


@pytest.mark.parametrize("signs", ["-", "++", "+-", "-+", "+++", "+-+", "++++", "-++-+--+"])
@pytest.mark.parametrize("shape", [(), (3,)])
def test_a_sum_adds_and_subtracts_from_left_to_right(signs, shape):
    random = np.random.default_rng(len(signs))
    inputs = {f"u{i + 1}": random.normal(size=(5, *shape)) for i in range(len(signs))}
    wanted = np.zeros((5, *shape))
    for sign, u in zip(signs, inputs.values()):
        wanted = wanted + u if sign == "+" else wanted - u
    assert np.array_equal(both_ways(lambda: Sum(signs), **inputs)["y"], wanted)


def test_nan_at_any_input_of_a_sum_passes():
    for i in range(4):
        assert math.isnan(Sum("+-+-").step(*[math.nan if k == i else 1.0 for k in range(4)]))
    assert math.isnan(Sum("+-").step(math.inf, math.inf))


@pytest.mark.parametrize("signs", ["", "+*", "1", "+ -", "plus"])
def test_invalid_signs_are_rejected(signs):
    with pytest.raises(DiagramError, match="signs must be one [+] or - for each"):
        Sum(signs)


def test_a_sum_with_an_input_left_open_does_not_compile():
    with Diagram("open", rate=100) as diagram:
        Sum("+-")(player([1.0]))
    with pytest.raises(DiagramError, match="sum.u2: the input is not connected"):
        compile(diagram)


def test_a_sum_of_different_units_does_not_compile():
    with Diagram("mixed", rate=100) as diagram:
        Sum("++")(player([1.0], "rad"), player([1.0], "N·m"))
    with pytest.raises(DiagramError, match="sum.u[12]: expected (rad|N·m), got (N·m|rad)"):
        compile(diagram)


@given(a=st.lists(anything, min_size=4, max_size=4), b=st.lists(anything, min_size=4, max_size=4))
def test_a_product_multiplies_each_element(a, b):
    with np.errstate(all="ignore"):
        assert np.array_equal(Product().step(np.array(a), np.array(b)), np.array(a) * np.array(b), equal_nan=True)


def test_the_unit_of_a_product_is_the_product_of_the_units():
    with Diagram("power", rate=100) as diagram:
        Product()(player([2.0, 3.0], "N·m"), player([5.0, 7.0], "rad/s"))
    assert compile(diagram).signals["product.y"].unit == "N·m·rad/s"
    assert run(diagram, 2)["product.y"].tolist() == [10.0, 21.0]


@given(
    ends=st.lists(finite, min_size=6, max_size=6),
    shares=st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3),
    gain=finite,
)
def test_outputs_stay_in_declared_range(ends, shares, gain):
    spans = [Interval(*sorted(ends[i : i + 2])) for i in (0, 2, 4)]
    u = [min(span.low + share * (span.high - span.low), span.high) for span, share in zip(spans, shares)]
    named = {f"u{i + 1}": span for i, span in enumerate(spans)}
    assert Gain(gain).step(u[0]) in Gain(gain).output_range(u=spans[0])
    assert Product().step(u[0], u[1]) in Product().output_range(a=spans[0], b=spans[1])
    for signs in ("+++", "+-+", "---", "-++"):
        assert Sum(signs).step(*u) in Sum(signs).output_range(**named)
