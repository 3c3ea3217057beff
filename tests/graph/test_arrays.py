"""Arrays end to end: ports of two axes, indices as NumPy has them, stacking, and scalars that broadcast where a block
says so.
"""

import numpy as np
import pytest

from blocks.filters import Exponential
from blocks.mathematics import Divide, Gain, Product, Sum
from blocks.sources import Constant
from blocks.vectors import MatrixGain, Stack
from graph import Block, Diagram, Input, Output, compile, stack
from graph.store import content_hash, from_json, to_json
from tests.blocks.running import player, run
from tests.graph.complaints import complaint, here

MATRIX = np.arange(6.0).reshape(2, 3)


class Source(Block):
    """A matrix that grows."""

    y = Output("N·m", "a matrix", shape=(2, 3))

    def step(self, tick):
        return MATRIX + tick


class Reversed(Block):
    """Turns a matrix upside down: it comes and goes as an array of its shape."""

    u = Input("any", "a matrix", shape=(2, 3))
    y = Output("any", "the same, upside down", shape=(2, 3))

    def step(self, u):
        assert u.shape == (2, 3)
        return u[::-1]


def recorded(signal_of, ticks=3):
    """The signal over the ticks, as an array of its shape."""
    with Diagram("d", rate=100) as diagram:
        signal = signal_of()
    found = run(diagram, ticks)
    names = [name for name in found.signals if name == signal.path or name.startswith(f"{signal.path}[")]
    shape = compile(diagram).signals[signal.path].shape
    return np.stack([found[name] for name in names], axis=1).reshape(ticks, *shape)


def test_a_matrix_passes_native_and_python_blocks():
    found = recorded(lambda: Gain(2.0)(Reversed()(Source()() + Source()())))
    assert np.array_equal(found, [4.0 * (MATRIX[::-1] + tick) for tick in range(3)])
    assert recorded(lambda: Exponential(1.0)(Source()())).shape == (3, 2, 3)


@pytest.mark.parametrize(
    "index",
    [
        0,
        -1,
        (1, 0),
        (0, -1),
        (slice(None), 1),
        (1, slice(None)),
        slice(0, 1),
        (slice(None, None, -1), slice(1, None)),
        (0, [2, 0]),
        [1, 0],
        ...,
        (slice(None), [0, 2]),
        (..., 1),
    ],
)
def test_indices_are_those_of_numpy(index):
    assert np.array_equal(recorded(lambda: Source()()[index]), [(MATRIX + tick)[index] for tick in range(3)])


@pytest.mark.parametrize(
    "index, words",
    [(2, "out of bounds"), ((0, 0, 0), "too many indices"), (slice(2, None), "must select at least one element")],
)
def test_an_index_beyond_is_refused_where_it_is_written(index, words):
    from graph import DiagramError

    with Diagram("d", rate=100), pytest.raises(DiagramError, match=words):
        Source()()[index]


def test_an_index_round_trips_through_json():
    with Diagram("d", rate=100) as diagram:
        source = stack(stack(1.0, 2.0), stack(3.0, 4.0))
        Stack(3, shape=(2,), name="all")(source[1, :], source[[1, 0], 0], source[:, 1])
    again = from_json(to_json(diagram))
    assert content_hash(again) == content_hash(diagram)
    assert [compile(d).signals["all.y"].shape for d in (diagram, again)] == [(3, 2), (3, 2)]
    assert np.array_equal(
        [run(again, 1)[f"all.y[{i}][{j}]"][0] for i in range(3) for j in range(2)], [3.0, 4.0, 3.0, 1.0, 2.0, 4.0]
    )


def test_rows_of_a_matrix_are_stacked_and_multiplied():
    gain = ((1.0, 0.0, 2.0), (0.0, 1.0, 0.0))
    found = recorded(lambda: stack(MatrixGain(gain)(Source()()[0]), Source()()[1, :2]))
    assert np.array_equal(found, [[np.array(gain) @ (MATRIX[0] + tick), MATRIX[1, :2] + tick] for tick in range(3)])


@pytest.mark.parametrize("make, law", [(Product, np.multiply), (Divide, np.divide)])
def test_a_scalar_is_combined_with_every_element_of_a_broadcasting_input(make, law):
    scalar, vector = np.array([2.0, 4.0, 8.0]), np.arange(1.0, 10.0).reshape(3, 3)
    for first, second in ((scalar, vector), (vector, scalar), (vector, vector), (scalar, scalar)):
        wide = max(first.ndim, second.ndim) > 1
        wanted = law(*(value[:, None] if wide and value.ndim == 1 else value for value in (first, second)))
        assert np.array_equal(recorded(lambda: make()(player(first, "1"), player(second, "1"))), wanted)


def test_a_python_block_that_broadcasts_receives_a_float():
    class Scaled(Block):
        """A vector times a number."""

        factor = Input("1", "a number, or one for each element", shape=..., broadcast=True)
        u = Input("any", "a vector", shape=...)
        y = Output("any", "u · factor", shape=...)

        def step(self, factor, u):
            assert isinstance(factor, float)
            return factor * u

    assert np.array_equal(
        recorded(lambda: Scaled()(3.0 * player(np.ones(3), "1"), player(np.ones((3, 2)), "any"))), np.full((3, 2), 3.0)
    )


def test_scalar_and_vector_signals_do_not_mix_without_broadcast():
    for swap in (False, True):
        with Diagram("d", rate=100) as diagram:
            signals = [Constant(1.0, name="one")(), Stack(3, name="three")(1.0, 2.0, 3.0)]
            Sum("++", name="sum")(*(reversed(signals) if swap else signals))
            at = here(-1)
        found = complaint(diagram)
        assert (found.code, found.path, found.port, found.where) == ("TW003", "sum", "u2" if swap else "u1", at)
        assert found.message == "expected shape (3,), got () from one.y"


def test_the_shape_in_a_loop_is_found_despite_scalars():
    from blocks.discrete import UnitDelay

    with Diagram("d", rate=100) as diagram:
        delay = UnitDelay(name="delay")
        gain = Product(name="gain")(0.5 * player(np.ones(4), "1"), delay.y)
        delay(Sum("++")(gain, stack(1.0, 2.0)))
    assert compile(diagram).signals["gain.y"].shape == (2,)


def test_a_broadcasting_block_has_any_shape():
    with pytest.raises(TypeError, match="broadcast requires shape=..., got"):
        Input("1", broadcast=True)
