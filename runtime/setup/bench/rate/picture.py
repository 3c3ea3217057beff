"""Picture of the highest rate over the number of actuators, beside the limit of the bus and the results of a paper."""

from collections.abc import Sequence
from typing import BinaryIO

from runtime.record.analysis import picture
from runtime.record.analysis.picture import BLUE, INK, ORANGE

PAPER = {"Jetson": 470.0, "Raspberry Pi 3B+": 260.0}  # Hz, with eight actuators (Leestma et al. 2025)
PAPER_COUNT = 8


def draw(rows: Sequence[tuple[int, float, float, float]], title: str, file: BinaryIO) -> None:
    """Draw the picture as a PNG.

    rows : (actuators, measured rate, rate at which the bus is full, the same with the worst stuffing), in Hz, None
        where unknown
    file : binary file, open for writing
    """
    figure = picture.figure(7.6, 5.0)
    axis = figure.subplots()
    counts = [count for count, *_ in rows]
    limits = [(count, limit, worst) for count, _, limit, worst in rows if limit is not None]
    if limits:
        x, top, bottom = zip(*limits)
        axis.fill_between(x, bottom, top, color=BLUE, alpha=0.12, linewidth=0)
        axis.plot(x, top, color=BLUE, linewidth=1.2, label="bus full, with the bits that were sent")
        axis.plot(x, bottom, color=BLUE, linewidth=1.2, linestyle=":", label="bus full, with the worst stuffing")
    axis.plot(
        counts,
        [measured for _, measured, _, _ in rows],
        "o",
        color=ORANGE,
        markersize=7,
        label="no answer missed",
        zorder=4,
    )
    for (name, rate), marker in zip(PAPER.items(), "sD"):
        axis.plot(
            [PAPER_COUNT],
            [rate],
            marker,
            color="none",
            markeredgecolor=INK,
            markersize=7,
            zorder=3,
            label=f"paper: {name}, {rate:.0f} Hz",
        )
    for count, measured, _, _ in rows:
        axis.annotate(
            f"{measured:.0f}", (count, measured), textcoords="offset points", xytext=(6, 6), fontsize=8, color=INK
        )
    axis.set_yscale("log")
    ticks = [200, 500, 1000, 2000, 5000]
    axis.set_yticks(ticks, [str(tick) for tick in ticks])
    axis.minorticks_off()
    axis.set_xticks(range(1, max(max(counts), PAPER_COUNT) + 1))
    axis.set_xlim(0.6, max(max(counts), PAPER_COUNT) + 0.6)
    axis.set_ylim(150, max(6000, 1.3 * max(measured for _, measured, _, _ in rows)))
    axis.set_xlabel("actuators on one bus", color=INK)
    axis.set_ylabel("rate [Hz]", color=INK)
    axis.set_title(title, fontsize=11, fontweight="bold", color=INK)
    picture.frame(axis)
    axis.legend(fontsize=8, frameon=False, labelcolor=INK)
    picture.save(figure, file)
