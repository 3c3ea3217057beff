"""What the module of a kind of line returns for each device: an open line, or the reason it could not be opened."""

import os
from dataclasses import dataclass

from runtime.rig.errors import Refused


@dataclass
class Opened:
    """A line that is open and set up.

    fd : of the line, which the caller now owns; close : called once nothing reads it any more, or None
    channel : name of the line in messages
    path : where it can be opened again, "" for nowhere; setup : messages sent again after that; record, is_gpio,
        reconnects, proof : as of cext.lines.streams.Streams.add
    remarks : lines for the operator before the run
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
    """Return {device: Opened or RigProblem} for lines that are independent of each other.

    opened : makes the Opened of a device, or raises Refused
    """
    found = {}
    for device in devices:
        try:
            found[device] = opened(device)
        except Refused as refused:
            found[device] = refused.trouble
    return found


def let_go(port):
    """Close an open pyserial port; return its descriptor, which the caller now owns."""
    descriptor = os.dup(port.fileno())
    port.close()
    return descriptor
