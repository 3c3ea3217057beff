"""Comparison of two recordings, signal by signal and tick by tick."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Difference:
    """Difference of one signal over the common ticks.

    ticks : number of ticks with different bits; all NaN count as equal
    first : the first such tick, with both values
    largest, rms : of the absolute difference; infinite if only one is NaN
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
    missing: tuple
    only_here: list
    only_there: list
    same: list
    differences: list

    @property
    def identical(self):
        return not (self.differences or self.only_here or any(self.missing))


def compare(here, there, order=()):
    """Compare two recordings.

    here, there : Trial
    order : paths in the order of the tick, if known, so that causes precede effects
    """
    shared, mine, others = np.intersect1d(here.tick, there.tick, assume_unique=True, return_indices=True)
    same, differences = [], []
    places = {path: index for index, path in enumerate(there.signals)}
    for index, (path, signal) in enumerate(here.signals.items()):
        if path not in places:
            continue
        a, b = here.rows[mine, index], there.rows[others, places[path]]
        differs = (a.view(np.int64) != b.view(np.int64)) & ~(np.isnan(a) & np.isnan(b))
        if not differs.any():
            same.append(path)
            continue
        first = int(np.argmax(differs))
        with np.errstate(invalid="ignore"):
            off = np.where(differs, np.abs(a - b), 0.0)
        off[np.isnan(off)] = np.inf
        differences.append(
            Difference(
                path,
                signal["unit"],
                int(differs.sum()),
                int(shared[first]),
                float(a[first]),
                float(b[first]),
                float(off.max()),
                float(np.sqrt(np.mean(off * off))),
            )
        )
    rank = {path: number for number, path in enumerate(order)}
    differences.sort(key=lambda difference: (difference.first, rank.get(difference.path, len(rank)), difference.path))
    return Comparison(
        len(shared),
        (len(here.tick) - len(shared), len(there.tick) - len(shared)),
        [path for path in here.signals if path not in places],
        [path for path in there.signals if path not in here.signals],
        same,
        differences,
    )


def sent_frames(trial):
    """Return the sent bytes up to the last complete row, since the safe stop after it follows the clock."""
    return [frame.payload for frame in trial.frames if frame.sent and frame.row < len(trial)]
