"""Cost of inertial sensors on serial lines: eight on pseudo-terminals beside a loop, and their parser by itself."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from blocks.families import benchmark
from blocks.mathematics import Gain
from blocks.sources import Sine
from cext.clock.histogram import counts_of
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.kernel_table import feed
from cext.schedule.program import Program
from graph import Diagram, compile
from runtime.host.console.progress import rounds
from runtime.host.ending import raise_if_ended_by_signal
from runtime.host.machine.realtime import PRIORITY, Realtime
from runtime.robot.rig.streams import StreamLines
from runtime.setup.bench.processes import emulation
from runtime.setup.bench.report import lateness

SENSORS, RATE, LOOP = 8, 500.0, 200.0  # how many; Hz
SERIALS = [str(700001 + number) for number in range(SENSORS)]
PACKETS = 4000  # pairs, of the parser's stream


@contextmanager
def plugged_in() -> Iterator[Path]:
    """Context manager of eight emulated sensors in a process of their own. Returns the folder of their ports."""
    with tempfile.TemporaryDirectory() as folder:
        with emulation("tests.bench.sensor_process", folder, str(RATE), *SERIALS, what="sensors"):
            yield Path(folder)


def loop(sensors: Path | None) -> tuple[Diagram, list[Any]]:
    """Return the diagram of ten native blocks and the sensors, and the blocks of the sensors.

    sensors : folder of the ports, None for no sensors
    """
    with Diagram("bench", rate=LOOP) as made:
        for index in range(5):
            Gain(2.0, name=f"gain{index}")(Sine(name=f"sine{index}")())
        devices = (
            [
                benchmark("stream").block(
                    port=str(sensors / f"tty{serial}"), rate=RATE, name=f"imu{serial}", timeout=0.0
                )
                for serial in SERIALS
            ]
            if sensors is not None
            else []
        )
    return made, devices


@dataclass
class Beside:
    """Samples pooled over chunks. lateness : counts; processor : s; wall : s; the rest are packets"""

    lateness: np.ndarray = field(default_factory=lambda: counts_of([]))
    processor: float = 0.0
    wall: float = 0.0
    packets: int = 0
    lost: int = 0
    corrupt: int = 0
    overflows: int = 0
    missed: int = 0


def chunk(totals: Beside, seconds: float, sensors: Path | None = None, realtime: str = "off") -> None:
    """Carry out one run, and add its samples to `totals`. Raises OSError if the sensors do not reply.

    sensors : folder of the ports, None for the loop alone
    """
    made, devices = loop(sensors)
    schedule = compile(made)
    lines = StreamLines(devices)
    if lines.problems:
        raise OSError(str(lines.problems[0]))
    shared = SharedState(1 << 22)
    with Realtime(realtime):
        lines.start(PRIORITY - 1 if realtime != "off" else 0)
        control = Program(schedule, [lines.lines[name][1].end for name in schedule.buses])
        executor = Executor(control, LOOP, shared=shared)
        processor, wall = time.process_time(), time.perf_counter()
        raise_if_ended_by_signal(executor.run(round(seconds * LOOP), arming_timeout=5.0))
        totals.processor += time.process_time() - processor
        totals.wall += time.perf_counter() - wall
    totals.lateness = totals.lateness + shared.counts("lateness")
    totals.missed += shared.statistics()["missed"]
    for device in devices:

        def reported(name: str) -> int:
            return int(control.final[schedule.signals[f"{device.path}.{name}"].slot])

        totals.packets += reported("packets")
        totals.lost += reported("lost")
        totals.corrupt += reported("corrupt")
        totals.overflows += lines.lines[device.bus][1].counts["overflows"]
    lines.close()


def measure(seconds: float, repeats: int, realtime: str = "off") -> tuple[Beside, Beside]:
    """Measure (the loop alone, the loop beside eight sensors) in alternating chunks."""
    alone, beside = Beside(), Beside()
    with plugged_in() as folder:
        chunk(Beside(), 0.2, folder, realtime)  # set up once
        for _ in rounds("measuring", repeats):
            chunk(alone, seconds, None, realtime)
            chunk(beside, seconds, folder, realtime)
    return alone, beside


# The parser


def parsed(repeats: int) -> tuple[float, float]:
    """Return (MB/s natively, in frames of 64 bytes as in a run; MB/s in Python), each the best of `repeats` chunks."""
    typical = benchmark("stream")
    assert typical.stream is not None and typical.parse is not None
    data = typical.stream(PACKETS, RATE)
    with Diagram("bench", rate=LOOP):
        block = typical.block(name="imu")
    scratch = block.scratch
    scratch.build({"tare": False})
    best = [float("inf"), float("inf")]
    for _ in range(repeats):
        began = time.perf_counter()
        feed(block.decode, scratch.arena, scratch.table(block.decode), data)
        best[0] = min(best[0], (time.perf_counter() - began) / len(data))
        began, part = time.perf_counter(), data[: len(data) // 10]
        typical.parse(part)
        best[1] = min(best[1], (time.perf_counter() - began) / len(part))
    return 1e-6 / best[0], 1e-6 / best[1]


def summary(alone: Beside, beside: Beside, native: float, python: float) -> dict[str, Any]:
    """Return the figures of the report. native, python : MB/s of the parsers"""
    return {
        "processor": beside.processor / beside.wall,
        "processor_alone": alone.processor / alone.wall,
        "packets": beside.packets,
        "lost": beside.lost,
        "corrupt": beside.corrupt,
        "overflows": beside.overflows,
        "missed": {"alone": alone.missed, "beside": beside.missed},
        "late_p50_us": {
            name: lateness(row.lateness, 0.5) * 1e6 for name, row in (("alone", alone), ("beside", beside))
        },
        "late_p99_us": {
            name: lateness(row.lateness, 0.99) * 1e6 for name, row in (("alone", alone), ("beside", beside))
        },
        "native_mb_s": native,
        "python_mb_s": python,
    }
