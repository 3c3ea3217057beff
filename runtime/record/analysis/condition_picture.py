"""Plots of conditions over the gait cycle: mean and standard deviation, one colour per condition."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from runtime.host.errors import BadInput
from runtime.record.analysis import picture
from runtime.record.analysis.condition_table import MINUS, deviation
from runtime.record.analysis.picture import COLOURS, GREY, INK, plain, short

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import BinaryIO

    from runtime.record.analysis.conditions import Condition


ROWS = (("angle", "deg"), ("torque", "N·m"), ("power", "W"))
LABEL_WIDTH = 60  # characters of a condition


def draw(conditions: Sequence[Condition], file: BinaryIO, kind: str) -> None:
    """Plot angle, torque and power of every leg.

    conditions : [Condition], as many as COLOURS or fewer
    file : open for writing bytes
    kind : "png" or "svg"

    Raises BadInput.
    """
    _check(conditions)
    known = [condition.legs() for condition in conditions]
    titles = list(dict.fromkeys(title for legs in known for title in legs))
    figure = picture.figure(4.6 * len(titles) + 1.2, 7.8)
    axes = figure.subplots(len(ROWS), len(titles), sharex=True, sharey="row", squeeze=False)
    per_kg = conditions[0].mass is not None
    for column, title in enumerate(titles):
        legs = [(number, legs[title]) for number, legs in enumerate(known) if title in legs]
        for row, (name, unit) in enumerate(ROWS):
            axis = axes[row][column]
            picture.gait_cycle(axis)
            toe_offs = {leg.toe_off for _, leg in legs}
            for number, leg in legs:
                values = leg.curves(name)
                _plot(axis, np.degrees(values) if name == "angle" else values, COLOURS[number])
                if leg.toe_off is not None:
                    colour = GREY if len(toe_offs) == 1 else COLOURS[number]
                    axis.axvline(100.0 * leg.toe_off, color=colour, linewidth=0.9, linestyle=":", zorder=2)
            if column == 0:
                first = legs[0][1]
                sign = f"\n{first.positive} +" if first.positive and name != "power" else ""
                unit = f"{unit}/kg" if per_kg and name != "angle" else unit
                axis.set_ylabel(plain(f"{first.joint} {name} [{unit}]{sign}"), color=INK)
        _heading(axes[0][column], title, legs, per_kg)
        axes[-1][column].set_xlabel("gait cycle [%]", color=INK)
    figure.align_ylabels(axes[:, 0])
    toe_off = any(leg.toe_off is not None for legs in known for leg in legs.values())
    _legend(figure, conditions, toe_off)
    picture.save(figure, file, kind)


def draw_signals(conditions: Sequence[Condition], paths: Sequence[str], file: BinaryIO, kind: str) -> None:
    """Plot scalar signals, one plot each. paths : paths of the signals

    Other arguments and errors are those of `draw`. Raises KeyError for an unknown signal.
    """
    _check(conditions)
    figure = picture.figure(8.0, 1.4 + 2.2 * len(paths))
    axes = figure.subplots(len(paths), 1, sharex=True, squeeze=False)[:, 0]
    for axis, path in zip(axes, paths):
        picture.gait_cycle(axis)
        counts = []
        for condition, colour in zip(conditions, COLOURS):
            values = condition.curves(path)
            counts.append(len(values))
            _plot(axis, values, colour)
        unit = conditions[0].trial.unit(path)
        count = _strides_text(counts[0]) if len(set(counts)) == 1 else f"{', '.join(map(str, counts))} strides"
        axis.set_title(plain(f"{path}, {count}"), loc="left", fontsize=9, color=INK)
        axis.set_ylabel("" if unit in ("1", "any") else f"[{unit}]", color=INK)
    axes[-1].set_xlabel("gait cycle [%]", color=INK)
    figure.align_ylabels(axes)
    _legend(figure, conditions, toe_off=False)
    picture.save(figure, file, kind)


def _check(conditions):
    """Raise BadInput for more conditions than COLOURS."""
    if len(conditions) > len(COLOURS):
        raise BadInput(
            f"{len(conditions)} conditions: at most {len(COLOURS)} can be distinguished in one picture. Pass fewer"
        )


def _plot(axis, values, colour):
    """Plot mean and standard deviation of curves. values : (strides, 101)"""
    picture.mean_and_sd(axis, values.mean(axis=0), deviation(values), colour)


def _heading(axis, title, legs, per_kg):
    """Write the name of a leg, with a line of figures for each condition in its colour."""
    unit = "J/kg" if per_kg else "J"
    for line, (number, leg) in enumerate(reversed(legs)):
        count = len(leg.strides)
        time, gain, loss = (
            np.mean([getattr(stride, name) for stride in leg.strides])
            for name in ("time", "positive_work", "negative_work")
        )
        axis.annotate(
            f"{count} stride{'s' * (count > 1)} of {time:.2f} s, work {gain:+.2f} and {loss:+.2f} {unit}".translate(
                MINUS
            ),
            xy=(0.5, 1.03),
            xycoords="axes fraction",
            xytext=(0, 11 * line),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8,
            color=COLOURS[number],
        )
    axis.set_title(plain(title), fontsize=11, fontweight="bold", color=INK, pad=10 + 11 * len(legs))


def _strides_text(count):
    """Return a number of strides as text."""
    return f"{count} stride{'s' * (count > 1)}"


def _legend(figure, conditions, toe_off):
    """Draw the legend of all plots."""
    marks = [
        *(
            Line2D([], [], color=colour, linewidth=2.0, label=plain(short(condition.label, LABEL_WIDTH)))
            for condition, colour in zip(conditions, COLOURS)
        ),
        Patch(color=GREY, alpha=0.25, label="± 1 standard deviation"),
    ]
    if toe_off:
        marks.append(
            Line2D([], [], color=GREY, linewidth=0.9, linestyle=":", label="toe-off (event_phase of GaitPhase)")
        )
    figure.legend(handles=marks, loc="outside lower center", ncols=2, fontsize=9, frameon=False, labelcolor=INK)
