"""Process that receives a stream of the Lab Streaming Layer, and passes its samples to the loop as lines of text.

    line    counter modulo 256, the channels, time stamp, offset of the sender's clock

liblsl has threads of its own and waits for the network: none of that is in the control process. If this process ends,
or the stream stalls, no lines arrive, and the block becomes stale.
"""

from __future__ import annotations

import json
import math
import os
import select
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from runtime.host.ending import ignore_signals
from runtime.host.errors import BadInput
from runtime.host.liblsl import Inlet, found
from runtime.host.run_mark import remove_mark
from runtime.robot.rig.line import text_of

WAIT = 0.1  # s, in which the end of the control process is noticed
CORRECTION_PERIOD = 1.0  # s


def main(answers: int, control: int, passed: int) -> None:
    """Run the process until the control process ends. The arguments are file descriptors."""
    ignore_signals()
    remove_mark()
    with open("/proc/self/comm", "w") as file:
        file.write("tickwork-lsl")
    wanted = json.loads(sys.stdin.readline() or "{}")
    try:
        inlet = find(wanted.get("stream", ""), wanted.get("source", ""))
        answer = inlet.about if isinstance(inlet, Inlet) else inlet
    except (BadInput, OSError) as error:
        inlet, answer = None, {"problem": str(error), "hint": "see docs/how_to/lsl.md"}
    os.write(answers, json.dumps(answer).encode() + b"\n")
    order = sys.stdin.readline()
    if isinstance(inlet, Inlet) and order:
        try:
            receive(inlet, socket.socket(fileno=passed), control, **json.loads(order))
        except OSError as error:
            sys.exit(f"tickwork: stream {inlet.about['name']!r}: {error.strerror}")


def find(stream: str, source: str) -> Inlet | dict[str, Any]:
    """Return an open Inlet, or {"problem", "hint"}. Raises MissingExtra or OSError."""
    infos = found(stream, source)
    if not infos:
        named = " and ".join(text for text in (stream and f"name {stream!r}", source and f"source {source!r}") if text)
        return {"problem": f"no stream in the network has the {named}"}
    if len(infos) > 1:
        several = ", ".join(f"{info.source or 'no source'} on {info.host}" for info in infos)
        return {"problem": f"{len(infos)} streams have this name: {several}", "hint": "name the source of one"}
    return Inlet(infos[0])


def receive(
    inlet: Inlet,
    passed: socket.socket,
    control: int,
    places: Sequence[int],
    scales: Sequence[float],
    rectify: float,
    max_delay: float,
) -> None:
    """Pass samples on until a process has ended. control : pidfd of the control process"""
    passed.setblocking(False)
    ended = select.poll()
    ended.register(control, select.POLLIN)
    counter, corrected, offset, restarts = 0, -math.inf, None, 0
    envelope = Rectified(len(places), rectify, inlet.rate) if rectify else None
    while not ended.poll(0):
        samples, stamps = inlet.pull(WAIT)
        if not stamps:
            continue
        now = inlet.clock()
        if now - corrected > CORRECTION_PERIOD or restarts != inlet.restarts:
            corrected, offset, restarts = now, inlet.correction(), inlet.restarts
        counter = (counter + 1) % 256
        if offset is None:
            continue
        now = inlet.clock()  # the first correction takes a while
        taken = [
            (stamp + offset, [sample[place] * scale for place, scale in zip(places, scales)])
            for sample, stamp in zip(samples, stamps)
            if abs(now - stamp - offset) <= max_delay
        ]
        if not taken:
            continue
        stamp, values = taken[-1]
        if envelope is not None:
            values = envelope.of([values for _, values in taken])
        with suppress(BlockingIOError):
            passed.send(f"{counter},{text_of(values)},{stamp:.9f},{offset:.9f}\n".encode())


class Rectified:
    """Mean of the absolute values of EMG samples after a high-pass filter of first order.

    width : number of channels; cutoff : Hz; rate : Hz, of the samples
    """

    def __init__(self, width: int, cutoff: float, rate: float) -> None:
        self.share = 1.0 / (1.0 + 2.0 * math.pi * cutoff / rate)
        self.before: list[float] | None = None
        self.passed = [0.0] * width

    def of(self, samples: Sequence[Sequence[float]]) -> list[float]:
        """Return the mean of each channel. samples : those that arrived together. A channel restarts after NaN."""
        sums = [0.0] * len(self.passed)
        for sample in samples:
            before = self.before or sample
            for channel, (value, last) in enumerate(zip(sample, before)):
                change = value - last
                self.passed[channel] = self.share * (self.passed[channel] + change) if math.isfinite(change) else 0.0
                sums[channel] += abs(self.passed[channel]) if math.isfinite(value) else math.nan
            self.before = list(sample)
        return [total / len(samples) for total in sums]
