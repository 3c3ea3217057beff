"""The picture of the average stride: a column a leg, angle, torque and power over the gait cycle."""

import warnings
from math import degrees

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from runtime.analysis.average_stride import left_out_text, signals_texts

# Blue for the leg, orange for the actuator, green for the power between them: told apart by colour-blind readers too.
# (Okabe and Ito 2008)
ROWS = (
    ("angle", "angle [deg]", "#0072B2", degrees),
    ("torque", "torque [N·m]", "#D55E00", float),
    ("power", "power [W]", "#009E73", float),
)
WIDEST, WIDEST_LINE = 38, 76  # letters of a title, and of a line of the small print below it
INK, GREY, FAINT = "#333333", "#666666", "#DDDDDD"


def draw(name, legs, file, kind="png"):
    """Write a picture.

    name : of the diagram
    legs : what StrideAverage reports of each leg, with at least one stride
    file : open for writing bytes
    kind : "png" or "svg"
    """
    figure = Figure(figsize=(4.2 * len(legs) + 1.0, 7.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(ROWS), len(legs), sharex=True, sharey="row", squeeze=False)
    for column, leg in enumerate(legs):
        for row, (curve, label, colour, convert) in enumerate(ROWS):
            axis = axes[row][column]
            plot(axis, leg["curves"][curve], colour, convert)
            if column == 0:
                axis.set_ylabel(label, color=INK)
            if row == 0:
                title(axis, leg)
        axes[-1][column].set_xlabel("gait cycle [%]", color=INK)
    figure.align_ylabels(axes[:, 0])
    figure.suptitle(plain(f"{name}: the average stride"), fontsize=13, fontweight="bold", color=INK)
    marks = [
        Line2D([], [], color=GREY, linewidth=2.0, label="mean"),
        Patch(color=GREY, alpha=0.25, label="± 1 standard deviation"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, fontsize=9, frameon=False, labelcolor=INK)
    save(figure, file, kind)


def plain(text):
    """A text of a picture in which a dollar is one, and begins no formula: names may have any letters."""
    return text.replace("$", r"\$")


def short(name, widest):
    """A name of so many letters at most: the end tells more than the beginning."""
    return name if len(name) <= widest else f"{name[: widest // 3]}…{name[1 + widest // 3 - widest :]}"


def save(figure, file, kind):
    """file : open for writing bytes; kind : "png" or "svg" """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a letter that the font has not got is drawn as a box
        figure.savefig(
            file,
            format=kind,
            metadata={"Software": "Tickwork"} if kind == "png" else {"Creator": "Tickwork", "Date": None},
        )


def plot(axis, curve, colour, convert):
    """One mean with a band of one standard deviation either side."""
    mean = [convert(value) for value in curve["mean"]]
    sd = [convert(value) for value in curve["sd"]]
    cycle = range(len(mean))
    axis.axhline(0.0, color="#AAAAAA", linewidth=0.8, zorder=1)
    axis.fill_between(
        cycle,
        [m - s for m, s in zip(mean, sd)],
        [m + s for m, s in zip(mean, sd)],
        color=colour,
        alpha=0.25,
        linewidth=0,
        zorder=2,
    )
    axis.plot(cycle, mean, color=colour, linewidth=2.0, zorder=3)
    axis.set_xlim(0, len(mean) - 1)
    axis.set_xticks(range(0, 101, 20))
    axis.margins(y=0.12)
    axis.grid(color=FAINT, linewidth=0.7)
    axis.set_axisbelow(True)
    axis.tick_params(colors=INK, labelsize=9, length=3)
    for side, spine in axis.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color("#888888")


def title(axis, leg):
    """The leg, and below it its numbers."""
    count = leg["strides"]
    lines = [*([f"left out: {left_out_text(leg)}"] if leg["left_out"] else []), *signals_texts(leg)]
    numbers = (
        f"{count} stride{'s' * (count > 1)} of {leg['stride_time']:.2f} s, peak torque {leg['peak_torque']:.1f} N·m\n"
        f"work a stride {leg['positive_work']:+.2f} J and {leg['negative_work']:+.2f} J".replace("-", "−")
    )
    axis.annotate(
        plain("\n".join(short(line, WIDEST_LINE) for line in lines)),
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
    axis.set_title(plain(short(leg["title"], WIDEST)), fontsize=11, fontweight="bold", color=INK, pad=40 + raised)
