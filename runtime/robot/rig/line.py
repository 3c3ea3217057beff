"""What the module of a kind of line returns for each device: an open line, or the reason it could not be opened."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from runtime.robot.rig.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from serial import Serial

    from graph import StreamDevice
    from runtime.robot.rig.errors import RigProblem

CHANNELS_ROOM = 960  # bytes for the channels in a line of 1023; the counter and the times take the rest


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


def text_of(numbers: Sequence[float]) -> str:
    """Return the channels of a sample as part of a line of text: exactly, unless the kernel's line is too short."""
    text = ",".join(map(repr, numbers))
    return text if len(text) <= CHANNELS_ROOM else ",".join([f"{number:.9g}" for number in numbers])


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
