"""Drawings as data: positions of boxes, frames and lines, in px from the top left corner, x right and y down."""

from dataclasses import dataclass, field
from typing import Any, TypeAlias

from graph.drawing.chart import Chart

Point: TypeAlias = tuple[float, float]
End: TypeAlias = str | tuple[str, str, str]
"""End of a line: the path of a port, "left/knee.torque", or (frame, side, signal) of a pin."""


@dataclass(frozen=True)
class Port:
    """End of lines on the edge of a box.

    side : "in", on the left, or "out", on the right; note : value of a constant wired to it
    signal : path of the signal, if it is not that of the port
    """

    name: str
    side: str
    x: float
    y: float
    note: str = ""
    wrong: bool = False
    signal: str = ""


@dataclass(frozen=True)
class Box:
    """A block, half of an actuator, or a subsystem that is like another.

    path : of the block; with "=command" for that half of an actuator, whose feedback is another box
    subsystem : path of the enclosing frame, "" for none; details : lines of parameters; wrong : its errors
    """

    path: str
    subsystem: str
    family: str  # a key of style.FAMILIES, or "subsystem"
    title: str
    subtitle: str
    details: tuple[str, ...]
    x: float
    y: float
    width: float
    height: float
    ports: tuple[Port, ...]
    wrong: tuple[str, ...] = ()
    chart: Chart | None = None


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
    """A subsystem or a part of it.

    path : "left", or "left=2" of its second part; subsystem : path of the enclosing frame
    note : its rate and condition, if it has its own; like : whether an earlier frame shows the same
    """

    path: str
    subsystem: str
    title: str
    note: str
    x: float
    y: float
    width: float
    height: float
    pins: tuple[Pin, ...]
    like: bool = False


@dataclass(frozen=True)
class Line:
    """Segment of a signal's path inside one frame, between two ports or pins.

    points : ends and corners; the line between two points is horizontal or vertical
    joints : corners at which other lines of the signal branch off
    back : whether its target is left of its source; loop : whether that closes a loop of blocks
    """

    signal: str
    subsystem: str
    source: End
    target: End
    points: tuple[Point, ...]
    joints: tuple[Point, ...] = ()
    back: bool = False
    loop: bool = False
    wide: bool = False  # carries more than one number
    wrong: bool = False


@dataclass(frozen=True)
class Drawing:
    """A drawing.

    cards : {path: description of a block}; signals : {path: text on a signal}
    elements : {path of a block that selects elements: path of the box that has them as an output}
    """

    name: str
    rate: float
    width: float
    height: float
    boxes: tuple[Box, ...]
    frames: tuple[Frame, ...]
    lines: tuple[Line, ...]
    cards: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    signals: dict[str, str] = field(default_factory=dict[str, str])
    elements: dict[str, str] = field(default_factory=dict[str, str])
