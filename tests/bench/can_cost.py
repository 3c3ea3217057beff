"""Cost of eight drives per tick; and eight motors at 1000 Hz on two buses, compared with a loop in C."""

from __future__ import annotations

import ctypes
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from blocks.families import benchmark
from blocks.limiters import TorqueLimiter
from blocks.sources import Sine
from cext.bus.memory_bus import MemoryBus
from cext.bus.socketcan import SocketCan
from cext.memory.shared_state import SharedState
from cext.schedule.bus_cost import time_of_control, time_of_ticks
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from runtime.host.console.progress import rounds
from runtime.host.ending import raise_if_ended_by_signal
from runtime.host.machine.realtime import Realtime
from runtime.setup.bench.processes import emulation
from runtime.setup.bench.rate.robot import UNLIMITED
from tests.bench.c_program import C_GRID, build

if TYPE_CHECKING:
    from graph import Schedule

SO_TIMESTAMPNS = 35
DRIVES = 8
ANSWERS = [(can_id, bytes([can_id]) + bytes.fromhex("7fff7ff7ff4600")) for can_id in range(1, DRIVES + 1)]  # at rest
RATE, BUSES = 1000.0, 2
STEPS = 4  # of the motors' process in a period
STARTING = 20  # ticks that are not counted

C_LOOP = (
    C_GRID
    + r"""
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>

/* Commands zero torque to motors 1 to room[1] on each of room[0] sockets, room[2] and on, at a period in ns. Returns
   the number of commands without an answer before the next one, from tick room[15] on; room[14] becomes the number of
   grid points that were missed. */
struct frame { uint32_t id; uint8_t length, spare[3], data[8]; };

double run(long period, long ticks, double *room, double *unused)
{
    struct grid grid = grid_from_now(period);
    struct frame frame;
    static const uint8_t zero[8] = {0x7f, 0xff, 0x7f, 0xf0, 0, 0, 7, 0xff};
    int buses = (int)room[0], motors = (int)room[1], owed[8][16] = {{0}}, bus, id;
    long long behind;
    long k, missed = 0, lost = 0;
    (void)unused;
    for (k = 0; k < ticks; k++) {
        behind = wait_for_point(&grid, k);
        if (behind < 0)
            return -1.0;
        for (; behind >= period && k < ticks - 1; behind -= period, k++)
            lost++;
        for (bus = 0; bus < buses; bus++) {
            while (recv((int)room[2 + bus], &frame, sizeof frame, MSG_DONTWAIT) == sizeof frame)
                if (frame.id <= 15)
                    owed[bus][frame.id] = 0;
            for (id = 1; id <= motors; id++) {
                missed += k >= (long)room[15] && owed[bus][id];
                owed[bus][id] = 1;
                memset(&frame, 0, sizeof frame);
                frame.id = id;
                frame.length = 8;
                memcpy(frame.data, zero, 8);
                send((int)room[2 + bus], &frame, sizeof frame, MSG_DONTWAIT);
            }
        }
    }
    room[14] = (double)lost;
    return (double)missed;
}
"""
)


@contextmanager
def ends() -> Iterator[list[socket.socket]]:
    """Context manager of two connected UDP sockets on the loopback interface, which time-stamp what they receive."""
    with ExitStack() as stack:
        pair = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
        for end in pair:
            end.bind(("127.0.0.1", 0))
            end.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        pair[0].connect(pair[1].getsockname())
        pair[1].connect(pair[0].getsockname())
        yield pair


def robot(buses: int = 1, drives: int = DRIVES) -> Diagram:
    """Return the Diagram of drives with a sine of torque, behind limiters.

    A busy machine ends no measurement: the sine is below the torque at which a drive must follow, as the replies of a
    measurement are fixed, and a drive that does not reply has no timeout, as missed replies are what is counted.
    """
    typical = benchmark("can")
    with Diagram("drives", rate=RATE) as diagram:
        torque = Sine(amplitude=0.5, frequency=1.0)()
        for bus in range(buses):
            for can_id in range(1, drives + 1):
                place = {"bus": f"bus{bus}", "can_id": can_id, "name": f"drive{bus}{can_id}", "timeout": 0.0}
                drive = typical.block(**typical.parameters, **place)
                drive.bitrate = UNLIMITED
                drive(torque_command=TorqueLimiter(limit=5.0, name=f"limiter{bus}{can_id}")(torque))
    return diagram


def native(rounds: int) -> tuple[list[int], list[int], list[int]]:
    """Time ticks of DRIVES drives.

    Returns ns of each tick (on a bus without system calls, over a socket, of the socket's two calls alone).
    """
    schedule = compile(robot())
    bus = MemoryBus()
    alone = time_of_control(Program(schedule, [bus.host]), bus.device, ANSWERS, rounds, RATE)
    with ends() as (own, other):
        can, far = SocketCan(own), SocketCan(other)
        through = time_of_control(Program(schedule, [can.end]), far.end, ANSWERS, rounds, RATE)
        _, calls = time_of_ticks(can.end, own.fileno(), other.fileno(), DRIVES, rounds)
    return alone, through, calls


@contextmanager
def motors(count: int) -> Iterator[list[socket.socket]]:
    """Context manager of BUSES sockets, at whose other ends a process emulates `count` motors each.

    Raises OSError if the process does not start.
    """
    with ExitStack() as stack:
        pairs = [stack.enter_context(ends()) for _ in range(BUSES)]
        numbers = [pair[1].fileno() for pair in pairs]
        arguments = map(str, (STEPS * RATE, count, *numbers))
        stack.enter_context(emulation("tests.bench.motors", *arguments, what="motors", descriptors=numbers))
        yield [pair[0] for pair in pairs]


def fast_motors(seconds: float, repeats: int) -> list[list[int]]:
    """Command motors at RATE from Tickwork and from a loop in C, in alternating chunks, both with `--realtime try`.

    Returns [replies missed, grid points missed, commands] of Tickwork and of C. Raises NoCompiler or OSError.
    """
    loop = build(C_LOOP)
    count = DRIVES // BUSES
    ticks = max(2 * STARTING, round(seconds * RATE))
    schedule = compile(robot(BUSES, count))
    totals = [[0, 0, 0], [0, 0, 0]]
    with motors(count) as sockets, Realtime("try"):
        for _ in rounds("measuring", repeats):
            for which, chunk in enumerate(
                (lambda: our_chunk(schedule, sockets, ticks), lambda: c_chunk(loop, sockets, count, ticks))
            ):
                for place, value in enumerate((*chunk(), DRIVES * (ticks - STARTING))):
                    totals[which][place] += value
    return totals


def our_chunk(schedule: Schedule, sockets: Sequence[socket.socket], ticks: int) -> tuple[int, int]:
    """Run Tickwork. Returns (replies missed, grid points missed)."""
    shared = SharedState(1 << 20)
    program = Program(schedule, [SocketCan(end, shared=True).end for end in sockets])
    program.count_from(STARTING)
    outcome = raise_if_ended_by_signal(Executor(program, RATE, shared=shared).run(ticks, fade=0.0))
    if outcome.status != "ok":
        raise OSError(f"the measurement ended: {outcome.status} at {outcome.culprit}. Repeat it on an idle machine")
    return sum(program.reports.missed.values()), shared.statistics()["missed"]


def c_chunk(loop: Callable[..., float], sockets: Sequence[socket.socket], count: int, ticks: int) -> tuple[int, int]:
    """Run the loop in C. Returns (replies missed, grid points missed).

    loop : compiled C_LOOP
    count : motors on each socket
    """
    room = (ctypes.c_double * 16)(BUSES, count, *(end.fileno() for end in sockets))
    room[15] = STARTING
    return int(loop(round(1e9 / RATE), ticks, room, room)), int(room[14])
