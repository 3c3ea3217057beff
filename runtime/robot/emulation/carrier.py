"""Process that carries frames between the rings of an emulator and python-can's interfaces."""

import errno
import json
import os
import select
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from cext.ring.rings import Lines
from runtime.host.ending import ignore_signals
from runtime.robot.emulation.priority import take_priority
from runtime.robot.guardian.wires import CannotOpen, open_wire

ORDERS = 0  # standard input
REST = 1  # ms between reads of an interface that cannot be polled
NAME = "tickwork-plant"


def main(answers: int, control: int, lines: int, bell: int) -> None:
    """Run the process. Arguments are file descriptors: answer pipe, pidfd of the emulator, lines, bell."""
    ignore_signals()
    with open("/proc/self/comm", "w") as file:
        file.write(NAME)
    with open(ORDERS, "rb", buffering=0, closefd=False) as orders:
        plan = json.loads(orders.readline() or b"[]")
    wires, failures = [], {}
    for bus in plan:
        try:
            wires.append(open_wire(bus))
        except CannotOpen as error:
            failures[bus["name"]] = str(error)
    with suppress(BrokenPipeError):
        os.write(answers, json.dumps(failures).encode() + b"\n")
    if not failures and plan:
        take_priority()
        _carry(wires, Lines(fd=lines), bell, control)
    for wire in wires:
        wire.close()


def _carry(wires: Sequence[Any], lines: Lines, bell: int, control: int) -> None:
    poll = select.poll()
    places = {wire.fileno(): wire for wire in wires if wire.fileno() is not None}
    for descriptor in (ORDERS, bell, control, *places):
        poll.register(descriptor, select.POLLIN)
    restless = len(places) < len(wires)
    while True:
        for descriptor, event in poll.poll(REST if restless else None):
            if descriptor in (ORDERS, control):
                return
            if descriptor == bell:
                with suppress(BlockingIOError):
                    os.eventfd_read(bell)
            elif event & ~select.POLLIN:
                poll.unregister(descriptor)
                places[descriptor].fail(errno.EIO, "the interface has hung up")
        for number, wire in enumerate(wires):
            for identifier, data, arrival, flags in wire.receive():
                lines.give(number, identifier, data, arrival, flags)
            for identifier, data, _ in lines.take(number):
                wire.send(identifier, data)
            if wire.trouble is not None:
                lines.fail(number, wire.trouble[0])
