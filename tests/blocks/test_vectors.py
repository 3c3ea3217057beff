"""Vectors against NumPy: putting together, taking apart, and linear algebra; shapes and units along the wires;
ranges.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.sources import Constant
from blocks.vectors import Concatenate, Cross, Dot, MatrixGain, Norm, Select, Stack
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.proofs import anything, finite, keeps_its_range, sensible
from tests.blocks.running import run

vectors = st.lists(sensible, min_size=3, max_size=3).map(np.array)


def test_scalars_stack_into_a_vector_and_vectors_into_a_matrix():
    assert Stack(3).step(1.0, 2.0, math.nan).tolist()[:2] == [1.0, 2.0]
    a, b = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    assert np.array_equal(Stack(2, shape=(3,)).step(a, b), np.stack([a, b]))
    assert np.array_equal(Stack(12).step(*range(12)), np.arange(12.0))


def test_vectors_and_scalars_join_end_to_end():
    joined = Concatenate((3, 1, 2)).step(np.array([1.0, 2.0, 3.0]), 4.0, np.array([5.0, 6.0]))
    assert joined.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


def test_negative_indices_select_from_the_end():
    u = np.array([10.0, 11.0, 12.0, 13.0])
    assert Select(1).step(u) == 11.0 and Select(-1).step(u) == 13.0
    assert Select((2, 0, -1, 2)).step(u).tolist() == [12.0, 10.0, 13.0, 12.0]
    assert Select((3,)).step(u).tolist() == [13.0]
    assert Select((1, 3)).step(u.reshape(2, 2)).tolist() == [11.0, 13.0]


def test_shapes_and_units_propagate_along_connections():
    with Diagram("d", rate=100) as diagram:
        force = Stack(3, name="force")(*(Constant(x, unit="N")() for x in (1.0, 2.0, 2.0)))
        lever = Stack(3, name="lever")(*(Constant(x, unit="m")() for x in (0.0, 0.0, 0.5)))
        Cross(name="torque")(lever, force)
        Norm(name="size")(force)
        Dot(name="work")(force, lever)
        Select(-1, name="last")(force)
        MatrixGain(((1.0, 0.0, 0.0), (0.0, 1.0, 1.0)), unit="1/m", name="map")(force)
        Concatenate((3, 1), name="all")(force, Select(0)(force))
    schedule, recording = compile(diagram), run(diagram, 1)
    found = {path: (place.shape, place.unit) for path, place in schedule.signals.items()}
    assert found["torque.y"] == ((3,), "N·m") and found["size.y"] == ((), "N") and found["work.y"] == ((), "N·m")
    assert found["last.y"] == ((), "N") and found["map.y"] == ((2,), "N/m") and found["all.y"] == ((4,), "N")
    assert [recording[f"torque.y[{i}]"][0] for i in range(3)] == [-1.0, 0.5, 0.0]
    assert (recording["size.y"][0], recording["work.y"][0], recording["last.y"][0]) == (3.0, 1.0, 2.0)
    assert [recording[f"map.y[{i}]"][0] for i in range(2)] == [1.0, 4.0]
    assert [recording[f"all.y[{i}]"][0] for i in range(4)] == [1.0, 2.0, 2.0, 1.0]


def test_an_element_that_does_not_exist_does_not_compile():
    with Diagram("d", rate=100) as diagram:
        Select(3)(Stack(3)(1.0, 2.0, 3.0))
    with pytest.raises(DiagramError, match="select: index 3 is out of bounds for a vector of length 3"):
        compile(diagram)


def test_a_vector_of_another_length_does_not_compile():
    with Diagram("d", rate=100) as diagram:
        MatrixGain(((1.0, 2.0),))(Stack(3)(1.0, 2.0, 3.0))
    with pytest.raises(DiagramError, match=r"expected shape \(2,\), got \(3,\)"):
        compile(diagram)


@given(vectors, vectors)
def test_products_are_those_of_numpy(a, b):
    """To the bit where NumPy does the same operations in the same order; within 1e-13 for sums that it may order
    otherwise.
    """
    assert np.array_equal(Cross().step(a, b), np.cross(a, b))
    assert Dot().step(a, b) == pytest.approx(np.dot(a, b), rel=1e-13, abs=1e-13)
    assert Norm().step(a) == pytest.approx(np.linalg.norm(a), rel=1e-15)
    matrix = tuple(map(tuple, np.outer(a, b) + np.eye(3)))
    assert MatrixGain(matrix).step(a) == pytest.approx(np.array(matrix) @ a, rel=1e-12, abs=1e-10)


def test_a_matrix_of_one_row_gives_a_scalar_and_a_row_in_a_row_a_vector():
    u = np.array([1.0, 2.0, 3.0])
    assert MatrixGain((1.0, 0.0, -1.0)).step(u) == -2.0 and np.shape(MatrixGain((1.0, 0.0, -1.0)).step(u)) == ()
    assert MatrixGain(((1.0, 0.0, -1.0),)).step(u).tolist() == [-2.0]
    assert MatrixGain(((1.0,), (2.0,))).step(np.array([3.0])).tolist() == [3.0, 6.0]


@pytest.mark.parametrize("make", [Norm, Dot, Cross, lambda: MatrixGain(((1.0, 0.0, 2.0), (0.0, 3.0, 0.0)))])
def test_nan_passes_and_is_not_stored(make):
    block = make()
    sound, broken = np.array([1.0, 2.0, 3.0]), np.array([1.0, math.nan, 3.0])
    count = len(block.inputs)
    first = block.step(*[sound] * count)
    assert np.any(np.isnan(block.step(*[broken] * count)))
    assert np.array_equal(block.step(*[sound] * count), first)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: Stack(0), "at least 1"),
        (lambda: Stack(2, shape=3), "whole numbers"),
        (lambda: Stack(2, shape=(0,)), "from 1 up"),
        (lambda: Concatenate(()), "at least"),
        (lambda: Concatenate((2.5,)), "whole numbers"),
        (lambda: Select(1.5), "whole numbers"),
        (lambda: Select(()), "must select at least one element"),
        (lambda: MatrixGain(((1.0, 2.0), (3.0,))), "of equal length"),
        (lambda: MatrixGain(((1.0, math.inf),)), "finite"),
        (lambda: MatrixGain(()), "rows of finite numbers"),
        (lambda: MatrixGain("unit"), "rows"),
    ],
)
def test_wrong_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


def test_selection_accepts_numpy_integers():
    assert Select(np.int64(1)).step(np.array([1.0, 2.0])) == 2.0


MAKERS = {
    "Stack": st.builds(Stack, st.integers(1, 5), st.sampled_from([(), (2,), (2, 2)])),
    "Concatenate": st.builds(Concatenate, st.lists(st.integers(1, 3), min_size=1, max_size=4).map(tuple)),
    "Select": st.builds(Select, st.sampled_from([0, -1, (0, 0), (-1, 0)])),
    "Norm": st.builds(Norm),
    "Dot": st.builds(Dot),
    "Cross": st.builds(Cross),
    "MatrixGain": st.builds(
        MatrixGain, st.lists(st.tuples(*[finite | sensible] * 3), min_size=1, max_size=3).map(tuple)
    ),
}


@pytest.mark.parametrize("kind", MAKERS)
@given(data=st.data())
def test_no_output_leaves_its_range(kind, data):
    keeps_its_range(
        data, data.draw(MAKERS[kind]), nan=True, ticks=3, shapes=((), (3,), (2, 2)), numbers=anything | sensible
    )


def test_ranges_are_tight():
    """Within 1e-14."""
    norm, dot = Norm(), Dot()
    norm.width = dot.width = 4
    assert norm.output_range(Interval(-1.0, 3.0)) == Interval(0.0, 6.0) and norm.output_range(
        Interval(1.0, 2.0)
    ) == Interval(2.0, 4.0)
    found = dot.output_range(Interval(-1.0, 2.0), Interval(0.0, 3.0))
    assert (found.low, found.high) == pytest.approx((-12.0, 24.0), rel=1e-14)
    found = Cross().output_range(Interval(0.0, 1.0), Interval(0.0, 2.0))
    assert (found.low, found.high) == pytest.approx((-2.0, 2.0), rel=1e-14)
    found = MatrixGain(((1.0, -2.0), (3.0, 0.0))).output_range(Interval(0.0, 1.0))
    assert (found.low, found.high) == pytest.approx((-2.0, 3.0), rel=1e-14)
