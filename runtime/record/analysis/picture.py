"""What all pictures share: colours, frames of plots, labels and the file."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from typing import BinaryIO

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike


INK, GREY, FAINT, AXIS = "#333333", "#666666", "#DDDDDD", "#888888"
# distinct for colour-blind readers (Okabe and Ito 2008)
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
BLUE, ORANGE, GREEN = COLOURS[:3]
AXIS_LIMIT = 1e150  # larger values are not drawn: Matplotlib fails where the range of an axis overflows


def figure(width: float, height: float, dpi: float = 150) -> Figure:
    """Return a new figure. width, height : inches"""
    made = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(made)
    return made


def frame(axis: Axes) -> None:
    """Draw the grid and the left and lower axis of a plot, and nothing else around it."""
    axis.grid(color=FAINT, linewidth=0.7)
    axis.set_axisbelow(True)
    for side, spine in axis.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(AXIS)


def gait_cycle(axis: Axes, size: float, step: int) -> None:
    """Draw the frame of a plot over the gait cycle in %, and a line at zero.

    size : of the numbers in points
    step : between the numbers of the gait cycle
    """
    axis.axhline(0.0, color="#AAAAAA", linewidth=0.8, zorder=1)
    axis.set_xlim(0, 100)
    axis.set_xticks(range(0, 101, step))
    axis.margins(y=0.12)
    frame(axis)
    axis.tick_params(colors=INK, labelsize=size, length=2.5, pad=2)


def drawable(values: ArrayLike) -> np.ndarray:
    """Return values as floats, NaN for those beyond AXIS_LIMIT."""
    values = np.asarray(values, float)
    return np.where(np.abs(values) < AXIS_LIMIT, values, np.nan)


def broken(ticks: np.ndarray, times: np.ndarray, values: np.ndarray, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and values of a line that ends where more than one sample in a row is missing.

    ticks : ticks of the samples
    times, values : times and values of the samples
    every : ticks from one sample to the next
    """
    gaps = np.flatnonzero(np.diff(ticks) > 2 * every) + 1
    return np.insert(times, gaps, times[gaps]), np.insert(values, gaps, np.nan)


def plain(text: str) -> str:
    """Escape the dollar signs of a label, which would begin a formula."""
    return text.replace("$", r"\$")


def short(name: str, width: int) -> str:
    """Shorten a name to so many characters. Most of its end is kept, where names differ."""
    return name if len(name) <= width else f"{name[: width // 3]}…{name[1 + width // 3 - width :]}"


def save(figure: Figure, file: BinaryIO, kind: str = "png", about: str = "") -> None:
    """Write a figure. Text stays text in SVG and PDF.

    file : binary file, open for writing
    kind : "png", "svg" or "pdf"
    about : description in the metadata of the file
    """
    creator = {"png": "Software", "svg": "Creator", "pdf": "Creator"}[kind]
    place = {"png": "Description", "svg": "Description", "pdf": "Subject"}[kind]
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    with warnings.catch_warnings(), rc_context({"svg.fonttype": "none", "pdf.fonttype": 42}):
        warnings.filterwarnings("ignore", "Glyph .* missing")  # such a character is drawn as a box
        figure.savefig(file, format=kind, metadata={creator: "Tickwork", place: about or None, **undated})
