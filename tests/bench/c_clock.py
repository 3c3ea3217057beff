"""A loop in C that only sleeps, to compare the lateness of the executor with."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from cext.clock.histogram import counts_of
from runtime.host.machine.realtime import Realtime
from runtime.setup.bench.clock import Contender, Samples
from tests.bench.c_program import C_GRID, build

C = "C, clock_nanosleep"
C_LOOP = (
    C_GRID
    + """
/* Wake-ups behind the grid, in ns; -1 where a grid point was missed. */
double run(long period, long ticks, double *late, double *unused)
{
    struct grid grid = grid_from_now(period);
    long long behind;
    long k;
    (void)unused;
    for (k = 0; k < ticks; k++) {
        behind = wait_for_point(&grid, k);
        if (behind < 0)
            return -1.0;
        for (; behind >= period && k < ticks - 1; behind -= period)
            late[k++] = -1.0;
        late[k] = (double)behind;
    }
    return 0.0;
}
"""
)


def contender() -> Contender:
    """Compile the loop. Returns the contender. Raises NoCompiler."""
    loop = build(C_LOOP)

    def chunk(rate, seconds, realtime, folder):
        late, off, missed = c_chunk(loop, rate, seconds, realtime)
        return Samples(counts_of(late), counts_of(off), len(late), missed)

    return chunk


def c_chunk(
    loop: Callable[..., float], rate: float, seconds: float, realtime: str
) -> tuple[np.ndarray, np.ndarray, int]:
    """Run the loop in C. Returns what the executor measures of itself.

    That is the lateness and |period - T| of its ticks, in ns, and the number of missed grid points.
    """
    ticks = round(seconds * rate)
    late, unused = (ctypes.c_double * ticks)(), (ctypes.c_double * 1)()
    with Realtime(realtime):
        loop(round(1e9 / rate), ticks, late, unused)
    return kept_time(np.frombuffer(memoryview(late)).astype(np.int64), round(1e9 / rate))


def kept_time(late: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Return (lateness of each tick, |period - T|, number of missed grid points), in ns.

    late : lateness of every grid point in ns, -1 for a missed one. The result is that behind the grid point that was
        awaited
    period : ns
    """
    ran = np.flatnonzero(late >= 0)
    missed = np.diff(ran, prepend=-1) - 1
    behind = late[ran] + missed * period
    return behind, abs(behind[1:] - late[ran][:-1]), int(missed.sum())
