"""Differences of two recordings as a table and as a plot: `python -m runtime diff A B`."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from runtime.record.analysis.conditions import trial_labels
from runtime.record.storage.grouping import PLAIN

if TYPE_CHECKING:
    from typing import BinaryIO

    from runtime.record.analysis.compare import Comparison, Difference
    from runtime.record.analysis.trial_data import TrialData


TABLE_ROW_LIMIT = 20
PLOT_LIMIT, CURVE_LIMIT = 6, 3  # plots, and signals in one
DASHES = ("-", (0, (4, 1.5)), (0, (1.2, 1.2)))  # of the signals in a plot
WINDOW = 4.0  # s of the plot, around the largest difference


def table(here: TrialData, there: TrialData, comparison: Comparison) -> list[str]:
    """Return the lines of a table of the differences, at most TABLE_ROW_LIMIT."""
    first, second = labels = trial_labels([here, there])
    lines = [f"{first} and {second}: {comparison.ticks} ticks in both"]
    if any(comparison.missing):
        lines.append(f"  {comparison.missing[0]} ticks only in {first}, {comparison.missing[1]} only in {second}")
    for label, paths in zip(labels, (comparison.only_here, comparison.only_there)):
        if paths:
            lines.append(f"  only in {label}: {', '.join(paths)}")
    if not comparison.differences and not comparison.same:
        return [*lines, "  no signal is in both"]
    if not comparison.differences:
        return lines + [f"  all {len(comparison.same)} signals are the same, bit for bit"]
    ranked = rank(comparison)
    zeros = len(comparison.differences) - len(ranked)
    names = [d.path if d.unit in PLAIN else f"{d.path} [{d.unit}]" for d in ranked[:TABLE_ROW_LIMIT]]
    width = max(map(len, names), default=0)
    if ranked:
        lines.append(f"  {'':{width}}  first tick   ticks that differ       largest           rms")
    for name, d in zip(names, ranked):
        lines.append(f"  {name:{width}}  {d.first:10}  {d.ticks:18}  {d.largest:12.4g}  {d.rms:12.4g}")
    if len(ranked) > TABLE_ROW_LIMIT:
        lines.append(f"  and {len(ranked) - TABLE_ROW_LIMIT} more signals differ")
    if zeros:
        lines.append(f"  {zeros} signal{' differs' if zeros == 1 else 's differ'} in the sign of zero alone")
    return lines + [f"  {len(comparison.same)} signals are the same, bit for bit"]


def rank(comparison: Comparison) -> list[Difference]:
    """Return the differences by block, the block of the earliest first, and of each by unit, then the largest.

    Those in the sign of zero alone are left out.
    """
    earliest = sorted((d for d in comparison.differences if d.largest), key=lambda d: (d.first, -d.rms))
    places: dict[tuple[str, ...], int] = {}
    for place, d in enumerate(earliest):
        places.setdefault((block_of(d),), place)
        places.setdefault((block_of(d), d.unit), place)
    return sorted(earliest, key=lambda d: (places[block_of(d),], places[block_of(d), d.unit]))


def block_of(difference: Difference) -> str:
    """Return the path of the block of a difference."""
    return difference.path.rpartition(".")[0]


def plots_of(comparison: Comparison) -> list[list[Difference]]:
    """Return the differences of each plot: those of one block and unit, of at most PLOT_LIMIT plots."""
    grouped = [list(group) for _, group in groupby(rank(comparison), key=lambda d: (block_of(d), d.unit))]
    return [group[first : first + CURVE_LIMIT] for group in grouped for first in range(0, len(group), CURVE_LIMIT)][
        :PLOT_LIMIT
    ]


def draw(file: BinaryIO, kind: str, here: TrialData, there: TrialData, comparison: Comparison) -> None:
    """Plot the signals that differ, by block and unit: both around their largest difference, and the difference.

    file : open for writing bytes; kind : "png", "svg" or "pdf"
    """
    from matplotlib.lines import Line2D

    from runtime.record.analysis import picture
    from runtime.record.analysis.picture import BLUE, COLOURS, FAINT, INK, ORANGE, broken, drawable, plain

    ticks, mine, others = np.intersect1d(here.tick, there.tick, assume_unique=True, return_indices=True)
    plots = plots_of(comparison)
    figure = picture.figure(12.0, 1.2 + 1.8 * len(plots), dpi=120)
    rows = figure.subplots(len(plots), 2, squeeze=False, width_ratios=(3, 2))
    first, second = map(plain, trial_labels([here, there]))
    for (near, far), group in zip(rows, plots):
        centre = None
        for d, dash, colour in zip(group, DASHES, COLOURS[2:]):
            every = math.lcm(here.every(d.path), there.every(d.path))
            both = ticks % every == 0
            time = here.time[mine[both]]
            a, b = here.column(d.path)[mine[both]].astype(float), there.column(d.path)[others[both]].astype(float)
            with np.errstate(invalid="ignore", over="ignore"):
                difference = b - a
            if centre is None:  # of the first, which the others share
                centre = time[np.argmax(np.nan_to_num(np.abs(difference), nan=np.inf))]
                far.axvspan(
                    max(time[0], centre - WINDOW / 2), min(time[-1], centre + WINDOW / 2), color=FAINT, zorder=0
                )
            shown = np.abs(time - centre) <= WINDOW / 2
            for values, tint in ((a, BLUE), (b, ORANGE)):
                line = broken(ticks[both][shown], time[shown], drawable(values)[shown], every)
                near.plot(*line, color=tint, linestyle=dash, linewidth=1.2)
            line = broken(ticks[both], time, drawable(difference), every)
            far.plot(*line, color=colour, linestyle=dash, linewidth=1.0)
        names = [Line2D([], [], color=INK, linestyle=dash, label=plain(d.path)) for d, dash in zip(group, DASHES)]
        options = {"frameon": False, "fontsize": 8, "labelcolor": INK, "borderaxespad": 0.0}
        near.legend(handles=names, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(group), **options)
        far.set_title(f"difference, from tick {min(d.first for d in group)} on", loc="left", fontsize=8, color=INK)
        near.set_ylabel("" if group[0].unit in PLAIN else f"[{group[0].unit}]", color=INK)
        for axis in (near, far):
            picture.frame(axis)
            axis.tick_params(colors=INK, labelsize=8.5, length=3)
    for axis in rows[-1]:
        axis.set_xlabel("time [s]", color=INK)
    figure.align_ylabels(rows[:, 0])
    conditions = [Line2D([], [], color=BLUE, label=first), Line2D([], [], color=ORANGE, label=second)]
    figure.legend(handles=conditions, loc="outside upper right", ncols=2, frameon=False, fontsize=9, labelcolor=INK)
    picture.save(figure, file, kind)
