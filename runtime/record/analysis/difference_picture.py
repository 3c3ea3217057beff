"""Differences of two recordings as a table and as a plot: `python -m runtime diff A B`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from runtime.record.storage.grouping import PLAIN

if TYPE_CHECKING:
    from typing import BinaryIO

    from runtime.record.analysis.compare import Comparison, Difference
    from runtime.record.analysis.trial_data import TrialData


TABLE_ROW_LIMIT = 20
PLOT_SIGNAL_LIMIT = 6
WINDOW = 4.0  # s of the plot, around the largest difference


def table(here: TrialData, there: TrialData, comparison: Comparison) -> list[str]:
    """Return the lines of a table of the differences, at most TABLE_ROW_LIMIT."""
    lines = [f"{here.path.name} and {there.path.name}: {comparison.ticks} ticks in both"]
    if any(comparison.missing):
        lines.append(f"  {comparison.missing[0]} ticks only in the first, {comparison.missing[1]} only in the second")
    for label, paths in (("first", comparison.only_here), ("second", comparison.only_there)):
        if paths:
            lines.append(f"  only in the {label}: {', '.join(paths)}")
    if not comparison.differences and not comparison.same:
        return [*lines, "  no signal is in both"]
    if not comparison.differences:
        return lines + [f"  all {len(comparison.same)} signals are the same, bit for bit"]
    ranked = rank(comparison)
    names = [d.path if d.unit in PLAIN else f"{d.path} [{d.unit}]" for d in ranked[:TABLE_ROW_LIMIT]]
    width = max(map(len, names))
    lines.append(f"  {'':{width}}  first tick   ticks that differ       largest           rms")
    for name, d in zip(names, ranked):
        lines.append(f"  {name:{width}}  {d.first:10}  {d.ticks:18}  {d.largest:12.4g}  {d.rms:12.4g}")
    if len(ranked) > TABLE_ROW_LIMIT:
        lines.append(f"  and {len(ranked) - TABLE_ROW_LIMIT} more signals differ")
    return lines + [f"  {len(comparison.same)} signals are the same, bit for bit"]


def rank(comparison: Comparison) -> list[Difference]:
    """Return the differences, the earliest first, then the largest."""
    return sorted(comparison.differences, key=lambda d: (d.first, -d.rms))


def draw(file: BinaryIO, kind: str, here: TrialData, there: TrialData, comparison: Comparison) -> None:
    """Plot the first signals that differ: both around their largest difference, and the difference over time.

    file : open for writing bytes; kind : "png", "svg" or "pdf"
    """
    from runtime.record.analysis import picture
    from runtime.record.analysis.picture import broken, drawable, plain

    ticks, mine, others = np.intersect1d(here.tick, there.tick, assume_unique=True, return_indices=True)
    shown_first = rank(comparison)[:PLOT_SIGNAL_LIMIT]
    figure = picture.figure(12.0, 1.2 + 1.8 * len(shown_first), dpi=120)
    rows = figure.subplots(len(shown_first), 2, squeeze=False, width_ratios=(3, 2))
    for (near, far), d in zip(rows, shown_first):
        every = math.lcm(here.every(d.path), there.every(d.path))
        both = ticks % every == 0
        time = here.time[mine[both]]
        a, b = here.column(d.path)[mine[both]].astype(float), there.column(d.path)[others[both]].astype(float)
        with np.errstate(invalid="ignore", over="ignore"):
            difference = b - a
        centre = time[np.argmax(np.nan_to_num(np.abs(difference), nan=np.inf))]
        shown = np.abs(time - centre) <= WINDOW / 2

        def line(values: np.ndarray, part: np.ndarray | slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
            return broken(ticks[both][part], time[part], drawable(values)[part], every)  # noqa: B023

        near.plot(*line(a, shown), color="#9aa3ad", linewidth=2.4, label=plain(here.path.name))
        near.plot(*line(b, shown), color="#c8452c", linewidth=1.1, label=plain(there.path.name))
        far.plot(*line(difference), color="#c8452c", linewidth=0.8)
        far.axvspan(time[shown][0], time[shown][-1], color="#9aa3ad", alpha=0.25, linewidth=0)
        near.set_title(plain(d.path), loc="left", fontsize=9)
        near.set_ylabel("" if d.unit in PLAIN else d.unit)
        far.set_title(f"difference, from tick {d.first} on", loc="left", fontsize=9)
        for axis in (near, far):
            axis.spines[["top", "right"]].set_visible(False)
            axis.tick_params(labelsize=8)
    for axis in rows[-1]:
        axis.set_xlabel("time [s]")
    figure.legend(
        *rows[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False, fontsize=8
    )
    picture.save(figure, file, kind)
