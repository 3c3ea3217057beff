"""Plot of the average stride: angle, torque and power over the gait cycle, one column per leg."""

from __future__ import annotations

from math import degrees
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from runtime.record.analysis import picture
from runtime.record.analysis.average_stride import left_out_text, signals_texts
from runtime.record.analysis.picture import BLUE, GREEN, GREY, INK, ORANGE, plain, short

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any, BinaryIO

    from matplotlib.axes import Axes


# {curve of a leg: label, colour, conversion from SI}: blue for the leg, orange for the actuator, green for the power
ROWS = (
    ("angle", "angle [deg]", BLUE, degrees),
    ("torque", "torque [N·m]", ORANGE, float),
    ("power", "power [W]", GREEN, float),
)
TITLE_WIDTH, NOTE_WIDTH = 38, 76  # characters of a title, and of a line of the small print above the plots


def draw(name: str, legs: Sequence[dict[str, Any]], file: BinaryIO, kind: str = "png") -> None:
    """Write the plot.

    name : name of the diagram
    legs : results of AverageStride for each leg, with at least one stride
    file : open for writing bytes
    kind : "png" or "svg"
    """
    made = picture.figure(4.2 * len(legs) + 1.0, 7.6)
    axes = made.subplots(len(ROWS), len(legs), sharex=True, sharey="row", squeeze=False)
    for column, leg in enumerate(legs):
        for row, (curve, label, colour, convert) in enumerate(ROWS):
            axis = axes[row][column]
            mean, sd = (np.array([convert(value) for value in leg["curves"][curve][part]]) for part in ("mean", "sd"))
            picture.gait_cycle(axis)
            picture.mean_and_sd(axis, mean, sd, colour)
            if column == 0:
                axis.set_ylabel(label, color=INK)
            if row == 0:
                title(axis, leg)
        axes[-1][column].set_xlabel("gait cycle [%]", color=INK)
    made.align_ylabels(axes[:, 0])
    made.suptitle(plain(f"{name}: the average stride"), fontsize=13, fontweight="bold", color=INK)
    marks = [
        Line2D([], [], color=GREY, linewidth=2.0, label="mean"),
        Patch(color=GREY, alpha=0.25, label="± 1 standard deviation"),
    ]
    made.legend(handles=marks, loc="outside lower center", ncols=2, fontsize=9, frameon=False, labelcolor=INK)
    picture.save(made, file, kind)


def title(axis: Axes, leg: dict[str, Any]) -> None:
    """Write the name of the leg with its figures below."""
    count = leg["strides"]
    lines = [*([f"excluded: {left_out_text(leg)}"] if leg["left_out"] else []), *signals_texts(leg)]
    numbers = (
        f"{count} stride{'s' * (count > 1)} of {leg['stride_time']:.2f} s, peak torque {leg['peak_torque']:.1f} N·m\n"
        f"work a stride {leg['positive_work']:+.2f} J and {leg['negative_work']:+.2f} J".replace("-", "−")
    )
    axis.annotate(
        plain("\n".join(short(line, NOTE_WIDTH) for line in lines)),
        xy=(0.5, 1.04),
        xycoords="axes fraction",
        ha="center",
        va="bottom",
        fontsize=7,
        color=GREY,
        linespacing=1.4,
    )
    raised = 10 * len(lines)
    axis.annotate(
        numbers,
        xy=(0.5, 1.04),
        xycoords="axes fraction",
        xytext=(0, raised),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=9,
        color=GREY,
        linespacing=1.4,
    )
    axis.set_title(plain(short(leg["title"], TITLE_WIDTH)), fontsize=11, fontweight="bold", color=INK, pad=40 + raised)
