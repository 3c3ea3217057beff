"""Statistics over windows: against exact sums, and without drift over a million samples."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.vectors import Concatenate
from blocks.windows import MovingAverage, MovingMaximum, MovingMinimum, MovingRMS, samples_in
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, DiagramError, Input, Interval, compile
from tests.blocks.playing import made, play, source
from tests.soaking import crossed

RATE = 1000.0
MILLION = 1_000_000
MIXED = st.one_of(st.floats(-1e6, 1e6), st.sampled_from([0.0, 1e6, -1e6, 1e-9, 0.1]))


LENGTHS = (7, 3001)
RUNS = [(kind, length) for kind in (MovingAverage, MovingRMS) for length in LENGTHS]
RUNS += [(kind, length) for kind in (MovingMaximum, MovingMinimum) for length in (1, 3001)]
CHECKPOINTS = np.linspace(max(LENGTHS), MILLION - 1, 1000).astype(int)  # ticks, the last among them


def signals():
    """A million samples of each, shape (MILLION, 4): noise; noise on a large offset; bursts a million million times
    larger than what follows them; noise with equals among its samples.
    """
    noise = np.random.default_rng(15).normal(0.0, 1.0, MILLION)
    bursts = noise * np.where(np.arange(MILLION) % 5000 < 1000, 1e12, 1.0)
    return np.stack([noise, 1e6 + noise, bursts, np.round(noise, 2)], axis=1)


@pytest.fixture(scope="module")
def million():
    """The signals, and the outputs of the blocks at the checkpoints by (kind, length), all of one run."""
    u = signals()
    taken, row = np.empty((len(CHECKPOINTS), 4 * len(RUNS))), {k: i for i, k in enumerate(CHECKPOINTS.tolist())}

    class Taker(Block):
        """Keeps its input at the checkpoints."""

        u = Input("any", "what is kept", shape=taken.shape[1:])

        def step(self, u, tick):
            if tick in row:
                taken[row[tick]] = u

    with Diagram("played", rate=RATE) as diagram:
        signal = source(u)
        Taker()(Concatenate((4,) * len(RUNS))(*(kind(length / RATE)(signal) for kind, length in RUNS)))
    Executor(Program(compile(diagram)), RATE).spin(MILLION)
    return u, {run: taken[:, 4 * i : 4 * i + 4] for i, run in enumerate(RUNS)}


@pytest.mark.parametrize("length, number", crossed(LENGTHS, range(3)))
@pytest.mark.soak
def test_a_moving_average_does_not_drift_over_a_million_samples(million, number, length):
    """Against math.fsum at a thousand checkpoints: within two roundings of the mean, and 1e-25 of the largest sample of
    two windows.
    """
    u, y = million[0][:, number], million[1][MovingAverage, length][:, number]
    for k, average in zip(CHECKPOINTS, y):
        window = u[k - length + 1 : k + 1].tolist()
        mean, largest = math.fsum(window) / length, np.abs(u[max(0, k - 2 * length) : k + 1]).max()
        assert abs(average - mean) <= 2.0 * math.ulp(mean) + 1e-25 * largest


@pytest.mark.soak
@pytest.mark.parametrize("length, number", crossed(LENGTHS, range(3)))
def test_a_moving_rms_does_not_drift_over_a_million_samples(million, number, length):
    u, y = million[0][:, number], million[1][MovingRMS, length][:, number]
    for k, rms in zip(CHECKPOINTS, y):
        root = math.sqrt(math.fsum(x * x for x in u[k - length + 1 : k + 1].tolist()) / length)
        largest = np.abs(u[max(0, k - 2 * length) : k + 1]).max()
        assert abs(rms - root) <= 3.0 * math.ulp(root) + 1e-25 * largest**2 / root


@pytest.mark.parametrize("length", [1, 3001])
def test_extremes_of_a_window_are_exact_over_a_million_samples(million, length):
    u, outputs = million[0][:, 3], million[1]
    for k, largest, smallest in zip(
        CHECKPOINTS, outputs[MovingMaximum, length][:, 3], outputs[MovingMinimum, length][:, 3]
    ):
        window = u[k - length + 1 : k + 1]
        assert largest == window.max() and smallest == window.min()


@given(u=st.lists(MIXED, min_size=1, max_size=60), length=st.integers(1, 12))
def test_a_window_that_is_not_full_uses_the_samples_so_far(u, length):
    blocks = [made(kind, length / RATE, rate=RATE) for kind in (MovingAverage, MovingRMS, MovingMaximum, MovingMinimum)]
    for k, x in enumerate(u):
        mean, rms, largest, smallest = (block.step(x) for block in blocks)
        window = u[max(0, k - length + 1) : k + 1]
        assert abs(mean - math.fsum(window) / len(window)) <= 1e-15 * max(map(abs, window)) + 1e-19
        assert (
            abs(rms - math.sqrt(math.fsum(v * v for v in window) / len(window)))
            <= 1e-15 * max(map(abs, window)) + 1e-12
        )
        assert largest == max(window) and smallest == min(window)


@given(
    u=st.lists(st.one_of(MIXED, st.sampled_from([math.nan, math.inf, -math.inf])), min_size=1, max_size=60),
    length=st.integers(1, 9),
)
def test_non_finite_sample_affects_output_only_while_in_window(u, length):
    blocks = [made(kind, length / RATE, rate=RATE) for kind in (MovingAverage, MovingRMS, MovingMaximum, MovingMinimum)]
    for k, x in enumerate(u):
        mean, rms, largest, smallest = (block.step(x) for block in blocks)
        window = u[max(0, k - length + 1) : k + 1]
        assert math.isnan(mean) == math.isnan(rms) == (not all(map(math.isfinite, window)))
        if not all(map(math.isfinite, window)):
            assert math.isnan(largest) and math.isnan(smallest)
        else:
            assert largest == max(window) and smallest == min(window)


@given(data=st.data(), length=st.integers(1, 20))
def test_no_statistic_leaves_its_range(data, length):
    low, high = sorted(data.draw(st.tuples(MIXED, MIXED)))
    within = st.one_of(st.floats(low, high), st.sampled_from([low, high]))
    blocks = [made(kind, length / RATE, rate=RATE) for kind in (MovingAverage, MovingRMS, MovingMaximum, MovingMinimum)]
    ranges = [block.output_range(u=Interval(low, high)) for block in blocks]
    for x in data.draw(st.lists(within, min_size=1, max_size=60)):
        for block, found in zip(blocks, ranges):
            assert block.step(x) in found


def test_ranges_are_tight():
    assert MovingMaximum().output_range(u=Interval(-1.0, 2.0)) == Interval(-1.0, 2.0)
    mean, rms = MovingAverage().output_range(u=Interval(-1.0, 2.0)), MovingRMS().output_range(u=Interval(-1.0, 2.0))
    assert (
        abs(mean.low + 1.0) < 1e-14 and abs(mean.high - 2.0) < 1e-14 and rms.low == 0.0 and abs(rms.high - 2.0) < 1e-14
    )
    assert MovingAverage().output_range(u=Interval(0.0)) == Interval() and MovingRMS().output_range(
        u=Interval()
    ) == Interval(0.0)
    assert abs(MovingRMS().output_range(u=Interval(-3.0, -2.0)).low - 2.0) < 1e-8


def test_a_large_sample_outside_the_window_has_no_effect():
    """1e15 comes and goes; what remains is the mean of ones, exactly."""
    u = np.ones(500)
    u[100] = 1e15
    y = play(lambda: MovingAverage(0.05), RATE, u=u)["y"]
    assert np.all(y[150:] == 1.0) and np.all(play(lambda: MovingRMS(0.05), RATE, u=u)["y"][150:] == 1.0)


def test_window_is_elementwise():
    u = np.random.default_rng(16).normal(size=(300, 3))
    u[40, 1] = math.nan
    for kind in (MovingAverage, MovingRMS, MovingMaximum, MovingMinimum):
        y = play(lambda: kind(0.02), RATE, u=u)["y"]
        for column in range(3):
            assert np.array_equal(y[:, column], play(lambda: kind(0.02), RATE, u=u[:, column])["y"], equal_nan=True)


def test_the_window_is_the_nearest_whole_number_of_samples():
    assert [samples_in(window, 0.005) for window in (0.005, 0.0074, 0.0076, 1.0, 20.0)] == [1, 1, 2, 200, 4000]


@pytest.mark.parametrize(
    "window, said",
    [
        (0.002, "a window of 0.002 s is shorter than half a sampling period of 0.005 s"),
        (6000.0, "a window of 6000 s has 1200000 samples at 200 Hz; the limit is 1000000"),
        (0.0, "window: must be above 0.0 s"),
    ],
)
def test_an_invalid_averaging_window_is_rejected(window, said):
    with pytest.raises((DiagramError, ValueError), match=said):
        made(MovingAverage, window).step(0.0)
