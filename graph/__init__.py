"""The language: blocks with typed ports, wired into diagrams, compiled into schedules. No I/O, no hardware, no threads.

from graph import Block, Diagram, Input, Output, Param, compile, subsystem
"""

from cext.kernel import Kernel
from graph.arithmetic import stack
from graph.block import Block, Sink
from graph.compiler import compile
from graph.declarations import Input, Live, Memory, Output, Param
from graph.device import Actuator, Device
from graph.device_data import (
    Caps,
    CommandReplies,
    DampedStop,
    Deviation,
    Motion,
    ReplyField,
    StopReply,
    TorqueBound,
    Watch,
    Winding,
    Zeroing,
)
from graph.diagnostics import Diagnostic, DiagramError
from graph.diagram import Diagram, subsystem
from graph.entry import main
from graph.function import block
from graph.interval import Interval
from graph.schedule import Schedule
from graph.signal import Signal
from graph.stream import StreamDevice
from graph.units import deg

__all__ = [
    "Actuator",
    "Block",
    "Caps",
    "CommandReplies",
    "DampedStop",
    "Deviation",
    "Device",
    "Diagnostic",
    "Diagram",
    "DiagramError",
    "Input",
    "Interval",
    "Kernel",
    "Live",
    "Memory",
    "Motion",
    "Output",
    "Param",
    "ReplyField",
    "Schedule",
    "Signal",
    "Sink",
    "StopReply",
    "StreamDevice",
    "TorqueBound",
    "Watch",
    "Winding",
    "Zeroing",
    "block",
    "compile",
    "deg",
    "main",
    "stack",
    "subsystem",
]


def _repr_svg_(diagram: Diagram) -> str:
    """Return the drawing of a diagram, which notebooks show."""
    from graph.drawing import draw, svg  # take 20 ms to import

    return svg(draw(diagram))


setattr(Diagram, "_repr_svg_", _repr_svg_)  # noqa: B010  # here, because the drawing imports Diagram
