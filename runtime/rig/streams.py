"""The lines of a robot on its rig: everything with a descriptor that is no CAN bus, opened and set up before anything
is armed.

A block says which kind of line it has and what is known of it (graph.StreamDevice: line, opening); the module of that
kind opens all lines of its kind at once, since who is found by a serial number is looked for at every port. From
`start` on one native thread reads them all.

A module of KINDS has `open_lines(devices)`, which returns {device: Opened, or the Trouble that keeps it from being
opened}.
"""

import importlib
import os
from dataclasses import dataclass

from cext.lines.streams import Streams
from runtime.rig.errors import Refused

KINDS = {  # kind of line: the module that opens it
    "serial": "runtime.rig.serial_line",
    "evdev": "runtime.rig.evdev_line",
    "gpio": "runtime.rig.gpio_line",
    "microstrain": "runtime.rig.microstrain",
    "net": "runtime.rig.net_line",
}


@dataclass
class Opened:
    """A line that is open and set up.

    fd : of the line, whose owner is from now on this; close : called once nothing reads it any more, or None
    channel : which one, for people
    path : where it can be opened again, "" for nowhere; setup : messages that it is then told; record, is_gpio,
        reconnects, proof : as of cext.lines.streams.Streams.add
    remarks : lines that a person should read before the run
    """

    fd: int
    channel: str
    path: str = ""
    setup: tuple = ()
    record: int = 1
    is_gpio: bool = False
    reconnects: bool = False
    proof: tuple = (b"", b"")
    remarks: tuple = ()
    close: object = None


def one_by_one(devices, opened):
    """`open_lines` of a kind whose lines have nothing to do with each other. opened : makes the Opened of a device, or
    raises Refused
    """
    found = {}
    for device in devices:
        try:
            found[device] = opened(device)
        except Refused as refused:
            found[device] = refused.trouble
    return found


@dataclass(frozen=True)
class Line:
    """What stands behind a line, as runtime.rig.file.RigBus has it of a bus."""

    name: str
    interface: str  # its kind
    channel: str


class StreamInterface:
    """bus : Line; virtual, remarks, strangers, close : as runtime.rig.interface.Interface has them"""

    virtual, strangers = False, None

    def __init__(self, bus, remarks):
        self.bus, self.remarks = bus, remarks

    def close(self):
        pass


class StreamLines:
    """
    devices : graph.StreamDevice of the robot, as the rig has it

    lines : {name of its bus: (StreamInterface, cext.lines.streams.Stream)}, of those that could be opened; troubles :
        of the others
    """

    def __init__(self, devices):
        self.streams, self.lines, self.troubles, self.closers = None, {}, [], []
        if not devices:
            return
        self.streams = Streams()
        for kind in sorted({device.line for device in devices}):
            here = [device for device in devices if device.line == kind]
            for device, found in importlib.import_module(KINDS[kind]).open_lines(here).items():
                if isinstance(found, Opened):
                    self.add(device, kind, found)
                else:
                    self.troubles.append(found)

    def add(self, device, kind, opened):
        stream = self.streams.add(
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
        self.lines[device.bus] = StreamInterface(Line(device.bus, kind, opened.channel), opened.remarks), stream

    def start(self, priority):
        """Read from now on. priority : of SCHED_FIFO where that is granted, 0 for an ordinary thread"""
        if self.streams is not None:
            self.streams.start(priority)

    def close(self):
        """Read no longer, and let go of every line."""
        if self.streams is None:
            return
        self.streams.end()
        for _, stream in self.lines.values():
            stream.close()  # its port is somebody else's from here on
        self.streams, closers, self.closers = None, self.closers, []
        for close in closers:
            close()
