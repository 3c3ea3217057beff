"""Colours, sizes and text widths of all drawings."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Family:
    """Title and colours of blocks of one kind. edge, head : colour of the edge and of the title bar"""

    title: str
    edge: str
    head: str


# Distinct in hue and lightness, also with red-green colour blindness. (After Okabe and Ito 2008.)
FAMILIES = {
    "actuator": Family("actuator", "#b8420b", "#ffd8c2"),
    "sensor": Family("sensor", "#00735a", "#c4efe2"),
    "source": Family("source", "#4d6b00", "#e6f2c0"),
    "filter": Family("filter", "#1b78b3", "#d5ecfb"),
    "controller": Family("controller", "#29489f", "#d3dcfa"),
    "logic": Family("logic", "#8b3f77", "#f6dcee"),
    "limiter": Family("limiter", "#8a6d00", "#ffee9e"),
    "sink": Family("recorder or viewer", "#3d4655", "#d6dbe3"),
    "other": Family("other", "#6b7280", "#f0f1f3"),
}

INK, FAINT, PAPER = "#1f2937", "#6b7280", "#ffffff"
WIRE, BACK, WRONG = "#475569", "#a8480f", "#d11a2a"
FRAME_EDGE, FRAME_FILL, FRAME_HEAD = "#b6bfcc", "#f8fafc", "#e8edf3"

FONT = "Inter, 'Helvetica Neue', Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"
TITLE, TEXT, SMALL = 13.0, 11.0, 10.0  # sizes of fonts

ROW = 18.0  # from port to port
HEAD = 24.0  # a box's head, with its title
LINE = 14.0  # one line of small text
PADDING = 9.0  # between a box's edge and its text
FRAME_TITLE = 26.0  # a frame's head
FRAME_PADDING = 16.0  # between a frame and what it holds
MARGIN = 24.0  # around the drawing

BETWEEN_BOXES = 28.0  # from box to box, downwards
BETWEEN_LINES = 12.0  # from line to line, side by side
CHANNEL = 34.0  # the least room for lines between two columns
CORNER = 6.0  # radius

# {width in hundredths of the font size: characters}, for the widest of the fonts above. Others: _DEFAULT_WIDTH.
_WIDTHS = {
    41: "' ijlIJ,.·:;|/\\-f()[]t!r",
    56: '"*_`°szcL?',
    73: "ABCRVXZKUαφΔ",
    84: "NHDGOQw#+<=>^~ωΩ±×÷≤≥→←−&",
    100: "W%@…mM",
}
_WIDTH = {letter: width / 100 for width, letters in _WIDTHS.items() for letter in letters}
_DEFAULT_WIDTH, _BOLD_FACTOR = 0.64, 1.12


def text_width(text: str, size: float, bold: bool = False) -> float:
    """Return the largest width in px of a line of text. size : size of the font, px"""
    return size * (_BOLD_FACTOR if bold else 1.0) * sum(_WIDTH.get(letter, _DEFAULT_WIDTH) for letter in text)


def fit(text: str, size: float, width: float, bold: bool = False) -> str:
    """Return the text, truncated with an ellipsis if it is wider than `width` px."""
    if text_width(text, size, bold) <= width:
        return text
    while text and text_width(text + "…", size, bold) > width:
        text = text[:-1]
    return text.rstrip() + "…"
