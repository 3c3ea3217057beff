"""A drawing as data: where every box, frame and line lies. Lengths are pixels, x to the right, y downwards, from the
drawing's corner.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Port:
    """One end of lines on the edge of a box. side : "in", on the left, or "out", on the right. note : value of a
    constant wired to it.
    """

    name: str
    side: str
    x: float
    y: float
    note: str = ""
    wrong: bool = False


@dataclass(frozen=True)
class Box:
    """A block. subsystem : path of the frame it stands in, "" for none. details : parameters worth showing. wrong : its
    errors.
    """

    path: str
    subsystem: str
    family: str  # a key of style.FAMILIES
    title: str
    subtitle: str
    details: tuple
    x: float
    y: float
    width: float
    height: float
    ports: tuple
    wrong: tuple = ()


@dataclass(frozen=True)
class Pin:
    """Where lines of one signal cross the edge of a frame. side : "in", "out", or "enabled" for what switches a
    subsystem on.
    """

    signal: str
    side: str
    x: float
    y: float


@dataclass(frozen=True)
class Frame:
    """A subsystem. subsystem : path of the frame around it. note : its rate and condition, where it has its own."""

    path: str
    subsystem: str
    title: str
    note: str
    x: float
    y: float
    width: float
    height: float
    pins: tuple


@dataclass(frozen=True)
class Line:
    """A piece of a signal's way inside one frame: from a port or pin to a port or pin.

    source, target : paths of ports, "left/knee.torque"; (frame, side, signal) of pins
    points : corners, ends included; every piece between two is level or upright
    joints : those of its corners where other lines of the signal leave it
    back : whether it goes against the flow, to a block that stands before its source
    """

    signal: str
    subsystem: str
    source: object
    target: object
    points: tuple
    joints: tuple = ()
    back: bool = False
    wide: bool = False  # carries more than one number
    wrong: bool = False


@dataclass(frozen=True)
class Drawing:
    """cards : what a reader may ask of a block, by path. signals : text on a signal, by path."""

    name: str
    rate: float
    width: float
    height: float
    boxes: tuple
    frames: tuple
    lines: tuple
    cards: dict = field(default_factory=dict)
    signals: dict = field(default_factory=dict)
