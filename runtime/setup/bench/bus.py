"""Cost of buses, over sockets of this machine.

CAN hardware adds its own.
"""

from __future__ import annotations

import os
import random
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import can

from cext.bus.socketcan import SocketCan
from cext.memory.shared_state import SharedState
from cext.ring.rings import Line, Lines
from cext.schedule.bus_cost import time_of_ticks
from runtime.host.machine.realtime import PRIORITY
from runtime.robot.guardian import GuardianProcess
from runtime.setup.bench.drives import node
from runtime.setup.bench.processes import emulation

if TYPE_CHECKING:
    from can import BusABC

    from cext.bus.memory_bus import BusEnd

SO_TIMESTAMPNS = 35
ID, COMMAND = 1, bytes.fromhex("7fff7ff0000007ff")  # zero torque
PACE = 0.001  # s between round trips
ROUNDS_OF_CALL = 500


def host_cost(frames: int = 8, rounds: int = 20_000) -> tuple[list[int], list[int]]:
    """Time a bus over UDP on the loopback interface.

    frames : frames received and sent per tick
    rounds : ticks

    Returns (ns of each tick's receive and send through a bus, ns of the two system calls alone).
    """
    with ExitStack() as stack:
        own, other = (stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2))
        for end in (own, other):
            end.bind(("127.0.0.1", 0))
        own.connect(other.getsockname())
        other.connect(own.getsockname())
        own.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        bus = SocketCan(own)
        time_of_ticks(bus.end, own.fileno(), other.fileno(), frames, rounds // 10)  # warm
        through, alone = [], []
        while len(through) < rounds:  # a signal is handled between two calls
            count = min(ROUNDS_OF_CALL, rounds - len(through))
            for times, new in zip(
                (through, alone), time_of_ticks(bus.end, own.fileno(), other.fileno(), frames, count), strict=True
            ):
                times += new
        return through, alone


def drives(channel: str, *identifiers: int) -> AbstractContextManager[None]:
    """Context manager of a process that emulates drives. Raises OSError if it does not start.

    channel : multicast group
    identifiers : ids of the drives
    """
    return emulation(
        "runtime.setup.bench.drives",
        channel,
        *map(str, identifiers),
        what="drives",
        remedy=". Check that multicast works on the loopback interface",
    )


def channel() -> str:
    """Return a random multicast group, unlikely to be in use."""
    return f"239.{random.randrange(1, 255)}.{random.randrange(255)}.{random.randrange(1, 255)}"


def round_trips(chunks: int = 10, trips: int = 200) -> tuple[list[float], list[float]]:
    """Time round trips to an emulated drive, in alternating chunks.

    Returns (s of each through python-can alone, s of each through the guardian). Raises OSError without a reply.
    """
    group = channel()
    direct, carried = [], []
    with drives(group, ID), through_guardian(group) as line, ExitStack() as stack:
        bus = node(group)
        stack.callback(bus.shutdown)
        for _ in range(chunks):
            direct += [_trip(lambda: send(bus), lambda: _await_answer(bus)) for _ in range(trips)]
            while line.receive():  # the guardian carried those frames as well
                pass
            carried += [
                _trip(lambda: line.send(ID, COMMAND), lambda: any(data[0] == ID for _, _, data, _ in line.receive()))
                for _ in range(trips)
            ]
            while bus.recv(0) is not None:
                pass
    return direct, carried


def _trip(send: Callable[..., Any], answered: Callable[..., Any]) -> float:
    time.sleep(PACE)
    began = time.perf_counter()
    send()
    while not answered():
        if time.perf_counter() - began > 1.0:
            raise OSError("a drive did not reply within 1 s")
    return time.perf_counter() - began


def send(bus: BusABC) -> None:
    """Send the command of zero torque to the drive ID."""
    bus.send(can.Message(arbitration_id=ID, is_extended_id=False, data=COMMAND))


def _await_answer(bus: BusABC) -> bool:
    message = bus.recv(0)
    return message is not None and message.data[0] == ID


@contextmanager
def through_guardian(group: str) -> Iterator[BusEnd]:
    """Context manager of the loop's end of a bus whose frames the guardian carries."""
    shared, lines, bell = SharedState(1 << 16), Lines(1), os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
    guardian = GuardianProcess(shared, lines, bell, [])
    try:
        guardian.configure(
            {
                "buses": [
                    {
                        "name": "bench",
                        "interface": "udp_multicast",
                        "channel": group,
                        "bitrate": 1_000_000,
                        "fd": False,
                        "data_bitrate": 0,
                        "options": {},
                        "virtual": False,
                        "line": 0,
                    }
                ],
                "devices": [],
                "locks": [],
                "relays": [],
                "items": [],
                "limit": 1.0,
                "priority": PRIORITY + 1,
            }
        )
        yield Line(lines, 0, bell).end
        guardian.finish()
    finally:
        guardian.kill()
        os.close(bell)
