"""Lateness of the executor.

Chunks of the contenders alternate, and the samples of each are pooled.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.clock.histogram import counts_of
from graph import Block, Diagram, Input, Output, compile
from runtime.host.console.progress import rounds
from runtime.host.ending import raise_if_ended_by_signal
from runtime.host.system import end_with_parent
from runtime.robot.loading.simulation import Simulation
from runtime.session.prepare import Prepared
from runtime.session.request import Request
from runtime.session.session import Session
from runtime.setup.bench.report import lateness as measured

SIGNALS = 60  # that are recorded


class Samples(NamedTuple):
    """What one chunk measured.

    lateness, period : counts, as in cext.clock.histogram.counts_of
    ticks, missed : grid points
    """

    lateness: np.ndarray
    period: np.ndarray
    ticks: int
    missed: int


Contender = Callable[[float, float, str, str], Samples]


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

    def add(self, samples: Samples) -> None:
        """Add the samples of a chunk."""
        if samples.lateness.any():
            self.each.append(measured(samples.lateness, 0.99))
        self.lateness, self.period = self.lateness + samples.lateness, self.period + samples.period
        self.ticks, self.missed = self.ticks + samples.ticks, self.missed + samples.missed

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


def chunk(rate: float, seconds: float, realtime: str, folder: str, python_blocks: int = 0) -> Samples:
    """Carry out one run with a recorder that writes files. Returns its samples.

    rate : Hz
    seconds : duration
    realtime : as in `--realtime`
    folder : folder of the recording
    python_blocks : number of Python blocks
    """
    made = diagram(rate, python_blocks)
    schedule = compile(made)
    request = Request(Path(__file__), duration=seconds, record=Path(folder), realtime=realtime)
    result = Session(
        Prepared(request, made, schedule, Simulation(None, made, schedule), None, round(seconds * rate))
    ).carry_out()
    raise_if_ended_by_signal(result.outcome)
    statistics, shared = result.statistics, result.shared
    assert shared is not None
    return Samples(shared.counts("lateness"), shared.counts("period"), statistics["ticks"], statistics["missed"])


CONTENDERS: dict[str, Contender] = {
    "Tickwork, native blocks": chunk,
    "Tickwork, ten Python blocks": partial(chunk, python_blocks=10),
}


def measure(
    contenders: Mapping[str, Contender],
    rates: Sequence[int],
    seconds: float,
    repeats: int,
    realtime: str = "off",
    load: bool = False,
    busy_thread: bool = False,
) -> dict[int, dict[str, Kept]]:
    """Measure contenders in alternating chunks. Returns {rate: {contender: Kept}}.

    contenders : {name: function of the rate, the duration, `realtime` and a folder that returns Samples}
    rates : Hz
    seconds : duration of a chunk
    repeats : chunks of each contender and rate
    realtime : as in `--realtime`
    load : whether every processor is kept busy by another process
    busy_thread : whether a Python thread of this process is kept busy
    """
    results = {rate: {name: Kept() for name in contenders} for rate in rates}
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        if load:
            stack.enter_context(busy_processors())
        if busy_thread:
            stack.enter_context(busy())
        for _ in rounds("measuring", repeats):
            for rate, each in results.items():
                for name, kept in each.items():
                    kept.add(contenders[name](rate, seconds, realtime, folder))
    return results


@contextmanager
def busy_processors() -> Iterator[None]:
    """Context manager in which other processes keep every processor busy. Ctrl-C does not reach them."""
    busy = [sys.executable, "-c", "while True: pass"]
    children = [
        subprocess.Popen(busy, preexec_fn=end_with_parent, start_new_session=True) for _ in range(os.cpu_count() or 1)
    ]
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
