"""Comparison of two recordings, signal by signal and tick by tick."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from runtime.record.analysis.trial_data import TrialData


@dataclass(frozen=True)
class Difference:
    """Difference of one signal over the ticks in which both recordings have it.

    ticks : number of ticks with different bits; all NaN count as equal
    first : the first such tick, with both values
    largest, rms : maximum and RMS value of the absolute difference; infinite if only one is NaN
    """

    path: str
    unit: str
    ticks: int
    first: int
    here: float
    there: float
    largest: float
    rms: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of two recordings.

    ticks : number of common ticks
    missing : number of ticks only in `here`, and only in `there`
    only_here, only_there : paths of signals in one recording only
    same : paths of signals with equal bits
    differences : [Difference], by first tick, then in the order of `order`
    """

    ticks: int
    missing: tuple[int, int]
    only_here: list[str]
    only_there: list[str]
    same: list[str]
    differences: list[Difference]

    @property
    def identical(self) -> bool:
        """Whether both recordings have the same ticks, and the signals of the first with the same bits."""
        return not (self.differences or self.only_here or any(self.missing))


class Comparer:
    """Comparison of two recordings of the same ticks, block by block.

    here, there : {path: signal} of the recordings, in the order of their rows
    """

    def __init__(self, here: Mapping[str, dict[str, Any]], there: Mapping[str, dict[str, Any]]) -> None:
        self.signals = {path: signal for path, signal in here.items() if path in there}
        places = {path: index for index, path in enumerate(there)}
        self.here = [index for index, path in enumerate(here) if path in places]
        self.there = [places[path] for path in self.signals]
        self.only_here = [path for path in here if path not in places]
        self.only_there = [path for path in there if path not in here]
        self.paths, self.ticks = list(self.signals), 0
        steps = [math.lcm(signal.get("every", 1), there[path].get("every", 1)) for path, signal in self.signals.items()]
        self.steps = np.array(steps, dtype=np.int64)  # ticks from one common sample of a signal to the next
        self.compared = np.zeros(len(steps), dtype=np.int64)  # samples of each signal
        self.sums = {}  # {path: [ticks, first, here, there, largest, sum of squares]} of the signals that differ

    def add(self, ticks: np.ndarray, here: np.ndarray, there: np.ndarray) -> None:
        """Add a block of ticks that both have.

        ticks : int64 array (n,)
        here, there : float64 arrays (n, signals)
        """
        a, b = np.ascontiguousarray(here[:, self.here]), np.ascontiguousarray(there[:, self.there])
        differs = (a.view(np.int64) != b.view(np.int64)) & ~(np.isnan(a) & np.isnan(b))
        for step in np.unique(self.steps):
            common = ticks % step == 0
            self.compared[self.steps == step] += int(common.sum())
            if step > 1:
                differs[np.ix_(~common, self.steps == step)] = False
        self.ticks += len(ticks)
        for column in np.flatnonzero(differs.any(axis=0)):
            where = differs[:, column]
            first = int(np.argmax(where))
            with np.errstate(invalid="ignore", over="ignore"):
                off = np.where(where, np.abs(a[:, column] - b[:, column]), 0.0)
                off[np.isnan(off)] = np.inf
                squares = float(np.sum(off * off))
            entry = self.sums.setdefault(
                self.paths[column], [0, int(ticks[first]), float(a[first, column]), float(b[first, column]), 0.0, 0.0]
            )
            entry[0] += int(where.sum())
            entry[4] = max(entry[4], float(off.max()))
            entry[5] += squares

    def result(self, order: Sequence[str], here: int, there: int) -> Comparison:
        """Return the Comparison.

        order : paths in the order of the tick, if known, so that causes precede effects
        here, there : number of ticks of either recording
        """
        samples = dict(zip(self.paths, self.compared.tolist()))
        rank = {path: number for number, path in enumerate(order)}
        differences = [
            Difference(
                path, self.signals[path]["unit"], count, first, a, b, largest, float(np.sqrt(squares / samples[path]))
            )
            for path, (count, first, a, b, largest, squares) in self.sums.items()
        ]
        differences.sort(
            key=lambda difference: (difference.first, rank.get(difference.path, len(rank)), difference.path)
        )
        return Comparison(
            self.ticks,
            (here - self.ticks, there - self.ticks),
            self.only_here,
            self.only_there,
            [path for path in self.paths if path not in self.sums],
            differences,
        )


def compare(here: TrialData, there: TrialData, order: Sequence[str] = ()) -> Comparison:
    """Compare two recordings.

    here, there : Trial
    order : paths in the order of the tick, if known, so that causes precede effects
    """
    shared, mine, others = np.intersect1d(here.tick, there.tick, assume_unique=True, return_indices=True)
    comparer = Comparer(here.signals, there.signals)
    comparer.add(shared, here.rows[mine], there.rows[others])
    return comparer.result(order, len(here.tick), len(there.tick))
