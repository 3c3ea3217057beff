"""Levels of detail against a naive computation, for windows of any size."""

import functools
import random

import numpy as np
import pytest

import runtime
from runtime.record.view import levels
from runtime.record.view.levels import BASE, Levels
from tests.runtime.record.view.recorded import RATE, SIGNALS, SLOW, SLOW_EVERY, TORQUE, recording, walk

MISSING = (5001, 5555)  # ticks that were missed, and single ones before them


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    ticks = [tick for tick in range(9000) if not MISSING[0] <= tick < MISSING[1] and tick not in (1000, 1003)]
    return runtime.load(recording(tmp_path_factory.mktemp("levels"), "trial", walk(ticks)))


def built(trial):
    made = Levels(trial)
    made.build()
    return made


@functools.cache
def expected(trial, place, size):
    """{number of an interval: (low, high, broken)} of a signal, one sample after the other."""
    every, found = SLOW_EVERY if place == SLOW else 1, {}
    for tick, value in zip(trial.tick.tolist(), trial.rows[:, place].tolist()):
        if tick % every == 0:
            found.setdefault(tick // every // size, []).append(value)
    result = {}
    for number, values in found.items():
        finite = [value for value in values if np.isfinite(value)]
        result[number] = (min(finite, default=np.nan), max(finite, default=np.nan), float(len(finite) < len(values)))
    return result


def check(made, trial, begin, end, width):
    pieces = made.window(range(len(SIGNALS)), begin, end, width)
    assert sorted(place for piece in pieces for place in piece.places) == list(range(len(SIGNALS)))
    sizes = set()
    for piece in pieces:
        every = SLOW_EVERY if SLOW in piece.places else 1
        assert piece.step == every / RATE
        numbers = np.round(piece.time / piece.step / piece.size).astype(int).tolist()
        assert len(numbers) <= 2 * width + 4  # the page is never sent more than fits its pixels
        for row, place in enumerate(piece.places):
            naive = expected(trial, place, piece.size)
            inside = [number for number in naive if begin <= number * piece.size * piece.step <= end]
            assert set(inside) <= set(numbers) <= set(naive)
            assert piece.size == 1 or (end - begin) / piece.step / piece.size >= width
            there = np.array([naive[number] for number in numbers]).reshape(-1, 3)
            np.testing.assert_array_equal(np.array([piece.low[row], piece.high[row], piece.broken[row]]).T, there)
        sizes.add(piece.size)
    return sizes


@pytest.mark.soak
def test_windows_of_any_size_equal_a_naive_computation(trial, monkeypatch):
    monkeypatch.setattr(levels, "GROUP_ROWS", 1001)  # ends anywhere in an interval
    made, dice, sizes = built(trial), random.Random(1), set()
    assert made.share == 1.0
    sizes |= check(made, trial, 0.0, 45.0, 10)
    for _ in range(40):
        width, span = dice.choice([7, 50, 300]), 45.0 * 10.0 ** dice.uniform(-3.0, 0.0)
        begin = dice.uniform(-0.2 * span, 45.0 - 0.8 * span)
        sizes |= check(made, trial, begin, begin + span, width)
    assert {1, 2, BASE, 4 * BASE} <= sizes and max(sizes) >= 8 * BASE  # read from the file, kept, and merged


@pytest.mark.soak
def test_a_long_recording_keeps_coarser_intervals_and_reads_the_finer_ones(trial, monkeypatch):
    monkeypatch.setattr(levels, "KEPT_LIMIT", 600)
    made = built(trial)
    assert made.grids[0].size == 16 * BASE and len(made.grids[0].places) * made.grids[0].count <= 600
    assert check(made, trial, 0.0, 45.0, 20) | check(made, trial, 8.0, 10.0, 60) >= {4, 256}


def test_before_all_is_built_a_window_has_the_part_that_is(trial):
    made = Levels(trial)
    assert made.window([TORQUE], 0.0, 45.0, 100) == []
    rows = next(trial.row_groups(2000))
    made.grids[0].add(rows, 0)
    for begin, end in ((0.0, 45.0), (9.9, 10.1)):  # kept, and read from the file
        [piece] = made.window([TORQUE], begin, end, 100)
        assert begin <= piece.time[0] + 0.5 and 9.9 <= piece.time[-1] <= 10.02


def test_a_signal_without_any_number_and_an_empty_recording(tmp_path):
    rows = [(tick, *([float("nan")] * len(SIGNALS))) for tick in range(100)]
    made = built(runtime.load(recording(tmp_path, "nothing", rows)))
    [piece] = made.window([TORQUE], 0.0, 1.0, 10)
    assert np.isnan(piece.low).all() and np.isnan(piece.high).all() and piece.broken.all()
    empty = built(runtime.load(recording(tmp_path, "empty", [])))
    assert empty.window([TORQUE], 0.0, 1.0, 10) == [] and empty.share == 1.0
