"""The lines of a robot on its rig: everything with a descriptor except CAN buses, opened and set up before arming.

A block declares its kind of line and how to open it (graph.StreamDevice: line, opening). The module of that kind opens
all lines of its kind at once, because a device with a serial number may be at any port. From `start` on one native
thread reads them all.

A module of KINDS has `open_lines(devices)`, which returns {device: Opened or RigProblem} (runtime.robot.rig.line).
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cext.lines.streams import Streams
from runtime.robot.rig.line import Opened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from graph import StreamDevice


KINDS = {  # kind of line: the module that opens it
    "dialogue": "runtime.robot.rig.dialogue_line",
    "serial": "runtime.robot.rig.serial_line",
    "evdev": "runtime.robot.rig.evdev_line",
    "gpio": "runtime.robot.rig.gpio_line",
    "lsl": "runtime.robot.rig.lsl_line",
    "net": "runtime.robot.rig.net_line",
    "ros2": "runtime.robot.rig.ros2_line",
}
SHOWN_KINDS = {"dialogue": "serial"}  # in tables, where the operator looks for the kind of port


@dataclass(frozen=True)
class Line:
    """Description of a line, with the attributes of runtime.robot.rig.file.RigBus."""

    name: str
    interface: str  # its kind
    channel: str


class StreamInterface:
    """Interface of a line. bus : Line; virtual, remarks, strangers, close : as runtime.robot.rig.interface.Interface"""

    virtual, strangers = False, None

    def __init__(self, bus: Line, remarks: Sequence[str]) -> None:
        self.bus, self.remarks = bus, remarks

    def close(self) -> None:
        """StreamLines closes the line."""


class StreamLines:
    """Lines of a robot.

    devices : graph.StreamDevice of the robot on its rig

    lines : {name of the bus: (StreamInterface, cext.lines.streams.Stream)} of the lines that could be opened
    problems : problems of the other devices
    settings : {path of a device: {name: text}} of what was read back
    """

    def __init__(self, devices: Sequence[StreamDevice]) -> None:
        self.streams, self.lines, self.problems = None, {}, []
        self.closers, self.settings = [], {}
        if not devices:
            return
        self.streams = streams = Streams()
        for kind in sorted({device.line for device in devices}):
            of_kind = [device for device in devices if device.line == kind]
            for device, opened in importlib.import_module(KINDS[kind]).open_lines(of_kind).items():
                if isinstance(opened, Opened):
                    self._add(streams, device, kind, opened)
                else:
                    self.problems.append(opened)

    def _add(self, streams, device, kind: str, opened):
        """Add an open line to the thread that reads them."""
        stream = streams.add(
            opened.fd,
            device.bus,
            path=opened.path,
            setup=opened.setup,
            record=opened.record,
            is_gpio=opened.is_gpio,
            level=opened.level,
            reconnects=opened.reconnects,
            proof=opened.proof,
        )
        os.close(opened.fd)
        if opened.close is not None:
            self.closers.append(opened.close)
        self.settings |= {device.path: opened.settings} if opened.settings else {}
        self.lines[device.bus] = (
            StreamInterface(Line(device.bus, SHOWN_KINDS.get(kind, kind), opened.channel), opened.remarks),
            stream,
        )

    def start(self, priority: int) -> None:
        """Start to read. priority : SCHED_FIFO priority if granted, else 0"""
        if self.streams is not None:
            self.streams.start(priority)

    def close(self) -> None:
        """End the reading thread, and close every line."""
        if self.streams is None:
            return
        self.streams.end()
        for _, stream in self.lines.values():
            stream.close()  # other processes may open the port from of_kind on
        self.streams, closers, self.closers = None, self.closers, []
        for close in closers:
            close()
