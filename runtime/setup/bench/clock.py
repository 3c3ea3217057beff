"""Lateness of the executor, compared with a loop in C that only sleeps.

The loop is compiled on this machine. Chunks alternate, and their samples are pooled.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.clock.histogram import counts_of
from graph import Block, Diagram, Input, Output, compile
from runtime.host.console.progress import rounds
from runtime.host.ending import uninterrupted
from runtime.host.machine.realtime import Realtime
from runtime.host.system import end_with_parent
from runtime.robot.loading.simulation import Simulation
from runtime.session.prepare import Prepared
from runtime.session.request import Request
from runtime.session.session import Session
from runtime.setup.bench.c_program import C_GRID, build
from runtime.setup.bench.report import lateness as measured

if TYPE_CHECKING:
    from runtime.session.result import Result

SIGNALS = 60  # that are recorded
PYTHON_BLOCKS = 10
C, NATIVE, PYTHON = "C, clock_nanosleep", "Tickwork, native blocks", "Tickwork, ten Python blocks"

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


@dataclass
class Kept:
    """Samples of one contender at one rate, pooled over its chunks.

    lateness, period : counts, as in cext.clock.histogram.counts_of
    ticks, missed : grid points
    each : s, the 99th percentile of the lateness of every chunk
    """

    lateness: np.ndarray = field(default_factory=lambda: counts_of([]))
    period: np.ndarray = field(default_factory=lambda: counts_of([]))
    ticks: int = 0
    missed: int = 0
    each: list[float] = field(default_factory=list)

    def add(self, lateness: np.ndarray, period: np.ndarray, ticks: int, missed: int) -> None:
        """Add the samples of a chunk. lateness, period : counts; ticks, missed : grid points"""
        if lateness.any():
            self.each.append(measured(lateness, 0.99))
        self.lateness, self.period = self.lateness + lateness, self.period + period
        self.ticks, self.missed = self.ticks + ticks, self.missed + missed

    def late(self, share: float) -> float:
        """Return the lateness in s that this share of the ticks does not exceed."""
        return measured(self.lateness, share)

    def off(self, share: float) -> float:
        """Return |period - T| in s that this share of the ticks does not exceed."""
        return measured(self.period, share)


class Pass(Block):
    """Python block with a minimal step: y = 0.5 u."""

    u = Input("any")
    y = Output("any")

    def step(self, u):
        return 0.5 * u


def diagram(rate: float, python_blocks: int = 0, signals: int = SIGNALS) -> Diagram:
    """Return a diagram of native blocks and a chain of Python blocks.

    signals : number of signals in all; every one is recorded
    """
    with Diagram("clock", rate) as made:
        signal = Sine(name="sine0")()
        for index in range(python_blocks):
            signal = Pass(name=f"python{index}")(signal)
        for index in range(1, (signals - python_blocks) // 2):
            Gain(2.0, name=f"gain{index}")(Sine(name=f"sine{index}")())
        Gain(2.0, name="gain0")(signal)
        CsvRecorder()
    return made


def chunk(rate: float, seconds: float, python_blocks: int, realtime: str, folder: str) -> Result:
    """Carry out one run with a recorder that writes files. Returns its Result.

    rate : Hz
    seconds : duration
    python_blocks : number of Python blocks
    realtime : as in `--realtime`
    folder : folder of the recording
    """
    made = diagram(rate, python_blocks)
    schedule = compile(made)
    request = Request(Path(__file__), duration=seconds, record=Path(folder), realtime=realtime)
    result = Session(
        Prepared(request, made, schedule, Simulation(None, made, schedule), None, round(seconds * rate))
    ).carry_out()
    uninterrupted(result.outcome)
    return result


def c_chunk(
    loop: Callable[..., float], rate: float, seconds: float, realtime: str
) -> tuple[np.ndarray, np.ndarray, int]:
    """Run the loop in C. Returns the figures that the executor measures of itself.

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


def measure(
    rates: Sequence[int],
    seconds: float,
    repeats: int,
    realtime: str = "off",
    load: bool = False,
    busy_thread: bool = False,
) -> dict[int, dict[str, Kept]]:
    """Measure the contenders in alternating chunks. Returns {rate: {contender: Kept}}. Raises NoCompiler.

    rates : Hz
    seconds : duration of a chunk
    repeats : chunks of each contender and rate
    realtime : as in `--realtime`
    load : whether every processor is kept busy by another process
    busy_thread : whether a Python thread of this process is kept busy
    """
    loop = build(C_LOOP)
    results = {rate: {name: Kept() for name in (C, NATIVE, PYTHON)} for rate in rates}
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        if load:
            stack.enter_context(loaded())
        if busy_thread:
            stack.enter_context(busy())
        for _ in rounds("measuring", repeats):
            for rate, contenders in results.items():
                late, off, missed = c_chunk(loop, rate, seconds, realtime)
                contenders[C].add(counts_of(late), counts_of(off), len(late), missed)
                for name, python_blocks in ((NATIVE, 0), (PYTHON, PYTHON_BLOCKS)):
                    result = chunk(rate, seconds, python_blocks, realtime, folder)
                    statistics, shared = result.statistics, result.shared
                    assert shared is not None
                    late, off = shared.counts("lateness"), shared.counts("period")
                    contenders[name].add(late, off, statistics["ticks"], statistics["missed"])
    return results


@contextmanager
def loaded() -> Iterator[None]:
    """Context manager in which other processes keep every processor busy."""
    busy = [sys.executable, "-c", "while True: pass"]
    children = [subprocess.Popen(busy, preexec_fn=end_with_parent) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for child in children:
            child.kill()
        for child in children:
            child.wait()


@contextmanager
def busy() -> Iterator[None]:
    """Context manager in which a Python thread of this process never rests."""
    done = False

    def work():
        while not done:
            pass

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done = True
        thread.join()
