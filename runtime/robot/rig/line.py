"""What the module of a kind of line returns for each device: an open line, or the reason it could not be opened."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from runtime.robot.rig.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from serial import Serial

    from graph import StreamDevice
    from runtime.robot.rig.errors import RigProblem


@dataclass
class Opened:
    """A line that is open and set up.

    fd : file descriptor of the line, which the caller now owns; close : called once nothing reads it any more, or None
    channel : name of the line in messages
    path : where it can be opened again, "" for nowhere; setup : messages sent again after that; record, is_gpio, level,
        reconnects, proof : as in cext.lines.streams.Streams.add
    remarks : lines for the operator before the run; settings : {name: text} of what was read back
    """

    fd: int
    channel: str
    path: str = ""
    setup: tuple[bytes, ...] = ()
    record: int = 1
    is_gpio: bool = False
    level: bool | None = None
    reconnects: bool = False
    proof: tuple[bytes, bytes] = (b"", b"")
    remarks: tuple[str, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    close: Callable[[], object] | None = None


def one_by_one(
    devices: Iterable[StreamDevice], opened: Callable[[StreamDevice], Opened]
) -> dict[StreamDevice, Opened | RigProblem]:
    """Return {device: Opened or RigProblem} for lines that are independent of each other.

    opened : makes the Opened of a device, or raises Refused
    """
    results = {}
    for device in devices:
        try:
            results[device] = opened(device)
        except Refused as refused:
            results[device] = refused.problem
    return results


def detach(port: Serial) -> int:
    """Close an open pyserial port; return its descriptor, which the caller now owns."""
    descriptor = os.dup(port.fileno())
    port.close()
    return descriptor
