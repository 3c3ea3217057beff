"""Lines from streams of the Lab Streaming Layer, which a process of its own receives.

Keys of `opening`:

    stream, source  name and source_id of the stream; an empty one selects any
    channels        (label, unit) of each channel to pass on
    rectify         Hz, see blocks.sensors.LslInlet
    max_delay       s
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from graph import units
from runtime.host.child_process import ChildProcess
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.line import Opened, one_by_one

if TYPE_CHECKING:
    from graph import StreamDevice

ANSWER_TIMEOUT = 30.0  # s
SPELLINGS = {  # units of XDF files
    "microvolts": "µV", "microvolt": "µV", "millivolts": "mV", "millivolt": "mV", "volts": "V", "volt": "V",
    "meters": "m", "meter": "m", "millimeters": "mm", "newtons": "N", "newton": "N", "seconds": "s", "radians": "rad",
}  # fmt: skip


class Receiver(ChildProcess):
    """The process of one stream. passed : AF_UNIX socket to which it sends samples as lines of text"""

    def __init__(self, module: str, passed: socket.socket, options: dict[str, Any]) -> None:
        super().__init__(module, (passed.fileno(),), (passed.fileno(),))
        self.order(options)

    def order(self, content: dict[str, Any]) -> None:
        """Send an order."""
        self._send(json.dumps(content).encode() + b"\n")

    def answer(self) -> dict[str, Any]:
        """Return its next answer; {"problem"} if there is none."""
        try:
            return self._answer(ANSWER_TIMEOUT) or {"problem": "its process ended"}
        except TimeoutError:
            return {"problem": "no reply of its process"}

    def close(self) -> None:
        """End the process."""
        self.end()


def open_lines(devices: Iterable[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: open_line(device.path, **device.opening()))


def open_line(path: str, stream: str, source: str, channels: Sequence[tuple[str, str]], **options: float) -> Opened:
    """Receive a stream. path : device named in messages. Raises Refused."""
    name = f'[device."{path}"] stream = "{stream}"'
    if not stream and not source:
        hint = f'write in the rig file: [device."{path}"] stream = "NAME"'
        raise Refused(RigProblem("TW102", f"{path} has no name of a stream", hint))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    with theirs:
        receiver = Receiver("runtime.robot.rig.lsl_receiver", theirs, {"stream": stream, "source": source})
    try:
        found = receiver.answer()
        if "problem" in found:
            hint = found.get("hint", "start its sender, and check that this network passes multicast")
            raise Refused(RigProblem("TW128", f"{name}: {found['problem']}", hint))
        if options["rectify"] and not found["rate"]:
            hint = "set rectify=0 in the diagram"
            raise Refused(RigProblem("TW102", f"{name}: rectify needs a stream with a sampling rate", hint))
        places, scales, remarks = select(name, channels, found["channels"])
        receiver.order({"places": places, "scales": scales, **options})
    except BaseException:
        ours.close()
        receiver.close()
        raise
    rate = f"{found['rate']:g} Hz" if found["rate"] else "without a rate"
    channel = f"{found['name']} on {found['host']}, {rate}"
    settings = {"stream": found["name"], "host": found["host"], "source": found["source"], "rate": f"{found['rate']:g}"}
    descriptor = os.dup(ours.fileno())
    ours.close()
    return Opened(descriptor, channel, remarks=tuple(remarks), settings=settings, close=receiver.close)


def select(
    name: str, wanted: Sequence[tuple[str, str]], given: Sequence[tuple[str, str]]
) -> tuple[list[int], list[float], list[str]]:
    """Return (index, factor of the unit) of each channel, and remarks. Raises Refused.

    wanted, given : (label, unit) of each channel that the diagram declares, and that the stream has
    """
    labels, places, scales, remarks = [label for label, _ in given], [], [], []
    labelled = any(labels)
    if not labelled and len(given) < len(wanted):
        hint = "declare as many channels as the stream has"
        raise Refused(RigProblem("TW102", f"{name} has {len(given)} channels, the diagram {len(wanted)}", hint))
    for number, (label, unit) in enumerate(wanted):
        if labelled and labels.count(label) != 1:
            hint = f"its channels are {', '.join(labels)}"
            raise Refused(RigProblem("TW102", f"{name} has {labels.count(label)} channels {label!r}", hint))
        place = labels.index(label) if labelled else number
        theirs = SPELLINGS.get(given[place][1].lower(), given[place][1])
        try:
            known = units.canonical(theirs) if theirs else ""
        except ValueError:
            known = ""
        try:
            scale = units.convert(1.0, known, unit) if known else 1.0
        except ValueError:
            hint = f'declare ("...", "{known}") in the diagram'
            raise Refused(
                RigProblem("TW102", f"{name}: channel {label!r} is in {known}, the diagram expects {unit}", hint)
            ) from None
        if not known and (theirs or unit != "1"):
            remarks.append(
                f"{name}: channel {label!r} has {f'unit {theirs}' if theirs else 'no unit'}, it is taken as {unit}"
            )
        places.append(place)
        scales.append(scale)
    return places, scales, remarks
