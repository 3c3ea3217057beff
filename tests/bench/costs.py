"""Costs of the parts of a tick: recording, histogram, time stamp; drift, memory, and a minute in virtual time."""

import os
import statistics
from fractions import Fraction
from pathlib import Path

import numpy as np

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.clock.deadline_clock import DeadlineClock
from cext.clock.histogram import time_of_add
from cext.clock.signals import Signals
from cext.clock.stopwatch import time_of_lap
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from runtime.host.ending import raise_if_ended_by_signal
from runtime.session.prepare import prepare
from runtime.session.request import Request
from runtime.session.session import Session
from runtime.setup.bench.clock import SIGNALS, diagram

KNEE_EXO = Path(__file__).parents[2] / "diagrams" / "knee_exo.py"
RATES = ("200", "1000", "3000", "333.3", "0.7")  # Hz
POINTS = 10**9


def recording(rounds: int = 7, ticks: int = 10_000) -> float:
    """Return the time in s that recording 60 signals adds to a tick."""

    def recorded(signals):
        with Diagram("recorded", 1000) as made:
            for index in range(SIGNALS // 2):
                Gain(2.0, name=f"gain{index}")(Sine(name=f"sine{index}")())
            if signals:
                CsvRecorder()
        return compile(made)

    schedules = [recorded(signals) for signals in (False, True)]
    differences = []
    for _ in range(rounds):
        took = []
        for schedule in schedules:
            shared = SharedState((ticks + 1) * 8 * (3 + len(schedule.columns)))
            raise_if_ended_by_signal(Executor(Program(schedule), 1000, shared=shared, virtual=True).run(ticks))
            counts = shared.statistics()
            took.append(counts["busy"] / counts["ticks"])
        differences.append(took[1] - took[0])
    return statistics.median(differences)


def histogram_add(rounds: int = 9) -> float:
    """Return the duration in s of adding a value to a histogram."""
    durations = np.random.default_rng(1).lognormal(np.log(25_000.0), 1.0, 4096).astype(np.int64)
    return statistics.median(time_of_add(durations, 50) for _ in range(rounds)) * 1e-9


def stamp(rounds: int = 9) -> float:
    """Return the duration in s of a time stamp with its histogram."""
    return statistics.median(time_of_lap() for _ in range(rounds))


def drift() -> float:
    """Return the error in s of 10⁹ grid points, the largest over RATES."""
    signals = Signals()
    clocks = [(rate, DeadlineClock(float(rate), signals)) for rate in RATES]
    return max(abs(clock.grid(POINTS) - POINTS * 10**9 / Fraction(rate)) for rate, clock in clocks) * 1e-9


def growth(few: int = 10_000, many: int = 10_000_000) -> int:
    """Return the growth of resident memory in bytes between `few` and `many` ticks, with an unread shared ring."""
    schedule = compile(diagram(1000, 3, 12))
    executor = Executor(Program(schedule), 1000, shared=SharedState(1 << 20), virtual=True)
    raise_if_ended_by_signal(executor.run(few))
    before = resident()
    raise_if_ended_by_signal(executor.run(many))
    return resident() - before


def resident() -> int:
    """Return the resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def knee_minute() -> tuple[float, float]:
    """Return (s of loop time, s of waiting for the recorder) of 60 s of the knee exoskeleton in virtual time."""
    result = Session(prepare(Request(KNEE_EXO, duration=60.0, fast=True, no_record=True))).carry_out()
    raise_if_ended_by_signal(result.outcome)
    counts = result.statistics
    return counts["busy"], counts["waited_for_recorder"]
