"""What all pictures share: colours, frames of plots, labels and the file."""

import warnings

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK, GREY, FAINT, AXIS = "#333333", "#666666", "#DDDDDD", "#888888"
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"  # distinct for colour-blind readers (Okabe and Ito 2008)


def figure(width, height, dpi=150):
    """Make a figure. width, height : inches"""
    made = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(made)
    return made


def frame(axis):
    """Draw the grid and the left and lower axis of a plot, and nothing else around it."""
    axis.grid(color=FAINT, linewidth=0.7)
    axis.set_axisbelow(True)
    for side, spine in axis.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(AXIS)


def plain(text):
    """Escape the dollar signs of a label, which would begin a formula."""
    return text.replace("$", r"\$")


def short(name, width):
    """Shorten a name to so many characters. Most of its end is kept, where names differ."""
    return name if len(name) <= width else f"{name[: width // 3]}…{name[1 + width // 3 - width :]}"


def save(figure, file, kind="png"):
    """Write a figure. file : binary file, open for writing; kind : "png" or "svg" """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # such a character is drawn as a box
        figure.savefig(
            file,
            format=kind,
            metadata={"Software": "Tickwork"} if kind == "png" else {"Creator": "Tickwork", "Date": None},
        )
