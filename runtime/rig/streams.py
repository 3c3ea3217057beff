"""The lines of a robot on its rig: everything with a descriptor except CAN buses, opened and set up before arming.

A block declares its kind of line and how to open it (graph.StreamDevice: line, opening). The module of that kind opens
all lines of its kind at once, because a device with a serial number may be at any port. From `start` on one native
thread reads them all.

A module of KINDS has `open_lines(devices)`, which returns {device: Opened or RigProblem} (runtime.rig.line).
"""

import importlib
import os
from dataclasses import dataclass

from cext.lines.streams import Streams
from runtime.rig.line import Opened

KINDS = {  # kind of line: the module that opens it
    "dialogue": "runtime.rig.dialogue_line",
    "serial": "runtime.rig.serial_line",
    "evdev": "runtime.rig.evdev_line",
    "gpio": "runtime.rig.gpio_line",
    "net": "runtime.rig.net_line",
}
SHOWN_KINDS = {"dialogue": "serial"}  # in tables, where the operator looks for the kind of port


@dataclass(frozen=True)
class Line:
    """Description of a line, with the attributes of runtime.rig.file.RigBus."""

    name: str
    interface: str  # its kind
    channel: str


class StreamInterface:
    """Interface of a line. bus : Line; virtual, remarks, strangers, close : as runtime.rig.interface.Interface"""

    virtual, strangers = False, None

    def __init__(self, bus, remarks):
        self.bus, self.remarks = bus, remarks

    def close(self):
        pass


class StreamLines:
    """Lines of a robot.

    devices : graph.StreamDevice of the robot on its rig

    lines : {name of the bus: (StreamInterface, cext.lines.streams.Stream)} of the lines that could be opened
    troubles : of the others
    """

    def __init__(self, devices):
        self.streams, self.lines, self.troubles, self.closers = None, {}, [], []
        if not devices:
            return
        self.streams = streams = Streams()
        for kind in sorted({device.line for device in devices}):
            here = [device for device in devices if device.line == kind]
            for device, opened in importlib.import_module(KINDS[kind]).open_lines(here).items():
                if isinstance(opened, Opened):
                    self.add(streams, device, kind, opened)
                else:
                    self.troubles.append(opened)

    def add(self, streams, device, kind: str, opened):
        stream = streams.add(
            opened.fd,
            device.bus,
            path=opened.path,
            setup=opened.setup,
            record=opened.record,
            is_gpio=opened.is_gpio,
            reconnects=opened.reconnects,
            proof=opened.proof,
        )
        os.close(opened.fd)
        if opened.close is not None:
            self.closers.append(opened.close)
        self.lines[device.bus] = (
            StreamInterface(Line(device.bus, SHOWN_KINDS.get(kind, kind), opened.channel), opened.remarks),
            stream,
        )

    def start(self, priority):
        """Start to read. priority : of SCHED_FIFO if granted, else 0"""
        if self.streams is not None:
            self.streams.start(priority)

    def close(self):
        """Stop to read, and close every line."""
        if self.streams is None:
            return
        self.streams.end()
        for _, stream in self.lines.values():
            stream.close()  # other processes may open the port from here on
        self.streams, closers, self.closers = None, self.closers, []
        for close in closers:
            close()
