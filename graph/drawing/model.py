"""Drawings as data: positions of boxes, frames and lines, in px from the top left corner, x right and y down."""

from dataclasses import dataclass, field
from typing import Any, TypeAlias

Point: TypeAlias = tuple[float, float]
End: TypeAlias = str | tuple[str, str, str]
"""End of a line: the path of a port, "left/knee.torque", or (frame, side, signal) of a pin."""


@dataclass(frozen=True)
class Port:
    """End of lines on the edge of a box.

    side : "in", on the left, or "out", on the right; note : value of a constant wired to it
    """

    name: str
    side: str
    x: float
    y: float
    note: str = ""
    wrong: bool = False


@dataclass(frozen=True)
class Box:
    """A block.

    subsystem : path of the enclosing frame, "" for none; details : lines of parameters; wrong : its errors
    """

    path: str
    subsystem: str
    family: str  # a key of style.FAMILIES
    title: str
    subtitle: str
    details: tuple[str, ...]
    x: float
    y: float
    width: float
    height: float
    ports: tuple[Port, ...]
    wrong: tuple[str, ...] = ()


@dataclass(frozen=True)
class Pin:
    """Crossing of a signal and the edge of a frame.

    side : "in", "out", or "enabled" for the signal that enables a subsystem
    """

    signal: str
    side: str
    x: float
    y: float


@dataclass(frozen=True)
class Frame:
    """A subsystem. subsystem : path of the enclosing frame; note : its rate and condition, if it has its own"""

    path: str
    subsystem: str
    title: str
    note: str
    x: float
    y: float
    width: float
    height: float
    pins: tuple[Pin, ...]


@dataclass(frozen=True)
class Line:
    """Segment of a signal's path inside one frame, between two ports or pins.

    points : ends and corners; the line between two points is horizontal or vertical
    joints : corners at which other lines of the signal branch off
    back : whether it is feedback, to a block left of its source
    """

    signal: str
    subsystem: str
    source: End
    target: End
    points: tuple[Point, ...]
    joints: tuple[Point, ...] = ()
    back: bool = False
    wide: bool = False  # carries more than one number
    wrong: bool = False


@dataclass(frozen=True)
class Drawing:
    """A drawing. cards : {path: description of a block}; signals : {path: text on a signal}"""

    name: str
    rate: float
    width: float
    height: float
    boxes: tuple[Box, ...]
    frames: tuple[Frame, ...]
    lines: tuple[Line, ...]
    cards: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    signals: dict[str, str] = field(default_factory=dict[str, str])
