"""Levels of detail: minimum and maximum of each signal over intervals of 2ⁿ samples.

A window of a page is as wide as its pixels, so that the process sends a few thousand numbers for a signal of an hour as
for one of a second. Intervals are counted from tick 0, and move with the signal when the window moves. Those of BASE
samples are built in one pass over the file and kept, as are coarser ones; finer ones are read from the file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from runtime.record.analysis.trial_data import TrialData
    from runtime.record.storage.batches import Rows

BASE = 16  # samples of the finest interval that is kept
FACTOR = 8  # from one kept level to the next
KEPT_LIMIT = 1 << 23  # intervals of all signals in the finest kept level, 16 bytes each
GROUP_ROWS = 1 << 14  # that are read at once
DRAWABLE_LIMIT = 1e150  # larger values are not drawn: the range of an axis could overflow


class Piece(NamedTuple):
    """Part of some signals at one level of detail.

    places : places of the signals in the row
    size : samples of an interval
    step : s from one sample to the next
    time : (n,) s of the first sample of each interval. Intervals without a tick are missing
    low, high : (places, n) minimum and maximum of the finite values; NaN without one
    broken : (places, n) whether a value is not finite
    """

    places: list[int]
    size: int
    step: float
    time: np.ndarray
    low: np.ndarray
    high: np.ndarray
    broken: np.ndarray


class Intervals(NamedTuple):
    """Intervals of equal size. number : (n,) of each interval; low, high, broken : (places, n) as in Piece"""

    number: np.ndarray
    low: np.ndarray
    high: np.ndarray
    broken: np.ndarray

    def part(self, begin: int, end: int) -> Intervals:
        """Return the intervals from one index up to another."""
        return Intervals(*(array[..., begin:end] for array in self))

    def of(self, places: Sequence[int]) -> Intervals:
        """Return the intervals of some signals."""
        return Intervals(self.number, self.low[places], self.high[places], self.broken[places])

    def merged(self, factor: int) -> Intervals:
        """Return intervals that are larger by a factor."""
        number = self.number // factor
        first = np.flatnonzero(np.diff(number, prepend=-1))
        if not len(first):
            return self
        return Intervals(
            number[first],
            np.fmin.reduceat(self.low, first, axis=1),
            np.fmax.reduceat(self.high, first, axis=1),
            np.logical_or.reduceat(self.broken, first, axis=1),
        )


def single(number: np.ndarray, values: np.ndarray) -> Intervals:
    """Return intervals of one sample. number : (n,) of the samples; values : (places, n)"""
    broken = ~(np.abs(values) < DRAWABLE_LIMIT)
    drawn = np.where(broken, np.nan, values)
    return Intervals(number, drawn, drawn, broken)


class Grid:
    """Levels of the signals that were recorded at every n-th tick.

    every : n
    places : places of the signals in the row
    rows : number of rows of the recording
    rate : Hz, of the ticks
    """

    def __init__(self, every: int, places: Sequence[int], rows: int, rate: float) -> None:
        self.every, self.places, self.step = every, list(places), every / rate
        self.order = {place: index for index, place in enumerate(self.places)}
        self.size = BASE
        while len(self.places) * rows / every / self.size > KEPT_LIMIT:
            self.size *= 2
        self.row = np.empty(0, dtype=np.int64)  # number of the first row of each interval
        self.count = self.added = 0  # intervals, and rows of the recording, that have been added
        self.kept = single(np.empty(0, dtype=np.int64), np.empty((len(self.places), 0)))  # with room for more
        self.coarser: list[tuple[int, Intervals]] = []  # (size, intervals) of the other kept levels

    def add(self, rows: Rows, before: int) -> None:
        """Add rows, in order. before : number of rows before them"""
        own = np.flatnonzero(rows.tick % self.every == 0)
        number = rows.tick[own] // self.every
        if not len(number):
            return
        at = np.flatnonzero(np.diff(number // self.size, prepend=-1))
        made = single(number, rows.values.T[self.places][:, own]).merged(self.size)
        begin = self.count
        if begin and self.kept.number[begin - 1] == made.number[0]:  # it continues the last one
            begin -= 1
            last = self.kept.part(begin, begin + 1)
            np.fmin(made.low[:, :1], last.low, out=made.low[:, :1])
            np.fmax(made.high[:, :1], last.high, out=made.high[:, :1])
            np.logical_or(made.broken[:, :1], last.broken, out=made.broken[:, :1])
        end = begin + len(at)
        if end > len(self.kept.number):
            self.grow(max(end, 2 * len(self.kept.number)))
        self.row[self.count : end] = before + own[at][self.count - begin :]
        for mine, new in zip(self.kept, made):
            mine[..., begin:end] = new
        self.count, self.added = end, before + len(rows.tick)

    def grow(self, room: int) -> None:
        """Make room for intervals."""

        def grown(array: np.ndarray) -> np.ndarray:
            made = np.empty((*array.shape[:-1], room), dtype=array.dtype)
            made[..., : self.count] = array[..., : self.count]
            return made

        self.row, self.kept = grown(self.row), Intervals(*map(grown, self.kept))

    def finish(self) -> None:
        """Build the coarser levels, once all rows have been added."""
        self.row, self.kept = self.row[: self.count], self.kept.part(0, self.count)
        size, level = self.size, self.kept
        while len(level.number) > FACTOR:
            size, level = size * FACTOR, level.merged(FACTOR)
            self.coarser.append((size, level))

    def piece(self, trial: TrialData, places: Sequence[int], begin: float, end: float, width: float) -> Piece:
        """Return a window, and the intervals beside it. Arguments as for `Levels.window`"""
        first, last = max(0, int(begin / self.step) - 1), max(0, int(end / self.step) + 2)
        size = 1
        while 2 * size * width <= (end - begin) / self.step:
            size *= 2
        count, kept, row = self.count, self.kept, self.row
        chosen = [self.order[place] for place in places]
        if size < self.size:
            low, high = np.searchsorted(kept.number[:count], (first // self.size, last // self.size), side="right")
            rows = trial.file.rows(places, int(row[max(0, low - 1)]), int(row[high]) if high < count else self.added)
            own = np.flatnonzero(rows.tick % self.every == 0)
            number = rows.tick[own] // self.every
            cut = slice(*np.searchsorted(number, (first // size * size, (last // size + 1) * size)))
            found = single(number[cut], rows.values.T[:, own[cut]])
            found = found if size == 1 else found.merged(size)
        else:
            level_size, level = self.size, kept.part(0, count)
            for other_size, other in self.coarser:
                if other_size <= size:
                    level_size, level = other_size, other
            ends = (first // size * (size // level_size), (last // size + 1) * (size // level_size))
            found = level.part(*map(int, np.searchsorted(level.number, ends))).of(chosen).merged(size // level_size)
        return Piece(list(places), size, self.step, found.number * (size * self.step), *found[1:])


class Levels:
    """Levels of detail of a recording.

    trial : TrialData with a file, which has been checked

    share : fraction of the rows that has been added
    """

    def __init__(self, trial: TrialData) -> None:
        self.trial, self.share, self.stopped = trial, 0.0, False
        groups: dict[int, list[int]] = {}
        for place, signal in enumerate(trial.about["signals"]):
            groups.setdefault(signal.get("every", 1), []).append(place)
        self.grids = [Grid(every, places, len(trial), trial.about["rate"]) for every, places in groups.items()]

    def build(self) -> None:
        """Add all rows, unless `stopped` is set meanwhile, by another thread."""
        done = 0
        for rows in self.trial.row_groups(GROUP_ROWS):
            if self.stopped:
                return
            for grid in self.grids:
                grid.add(rows, done)
            done += len(rows.tick)
            self.share = done / len(self.trial)
        for grid in self.grids:
            grid.finish()
        self.share = 1.0

    def window(self, places: Sequence[int], begin: float, end: float, width: float) -> list[Piece]:
        """Return signals in a window, as far as they have been built.

        places : places of the signals in the row
        begin, end : s
        width : pixels. There are at least as many intervals, and at most twice as many and a few

        Raises BadInput if the file has changed.
        """
        pieces = []
        for grid in self.grids:
            chosen = [place for place in places if place in grid.order]
            if chosen and grid.count:
                pieces.append(grid.piece(self.trial, chosen, begin, end, width))
        return pieces
