"""Processor time of the recorder per tick: 36 signals and 4 frames on one bus, as in diagrams/knee_exo.py."""

import math
import os
import tempfile
import time
from typing import Any

from cext.memory.shared_state import RECORD_FRAME, RECORD_RECEIVED, RECORD_ROW, SharedState
from cext.recording.ring_batch import read
from runtime.record.recorder.part import Recording
from runtime.record.storage.format import Frame, row_struct

SIGNALS, RATE = 36, 200.0
FLUSH_TICKS = 100
PERIOD_NS = round(1e9 / RATE)


def columns() -> list[dict[str, Any]]:
    """Return the description of the signals, as in the plan of a recorder."""
    return [
        {
            "index": index,
            "path": f"{'left' if index < SIGNALS // 2 else 'right'}/block{index // 4}.x{index}",
            "dtype": "float",
            "unit": "rad",
            "ascii_unit": "rad",
        }
        for index in range(SIGNALS)
    ]


def values(tick: int) -> list[float]:
    """Return the signals of a tick: sinusoids and, for every third signal, a step function."""
    wave = math.sin(0.01 * tick)
    return [wave * (index + 1) if index % 3 else float(math.floor(wave * index)) for index in range(SIGNALS)]


def tick_records(tick: int) -> list[tuple[int, bytes]]:
    """Return the records of a tick in the ring: [(kind, payload)]."""
    data = round(32767 * math.sin(0.01 * tick)).to_bytes(2, "big", signed=True) + b"\x7f\xf0\0\0\x07\xff"
    time_ns = PERIOD_NS * tick
    received, sent = (
        [Frame(time_ns, motor, False, False, False, False, False, False, way, 0, data).pack() for motor in (1, 2)]
        for way in (False, True)
    )
    row = row_struct(SIGNALS).pack(tick, 0.0, *values(tick))
    drain = RECORD_RECEIVED, time_ns.to_bytes(8, "little")
    return [drain, *((RECORD_FRAME, frame) for frame in received + sent), (RECORD_ROW, row)]


def measure(csv: bool, ticks: int = 20_000, compression: str = "zstd") -> tuple[float, float]:
    """Return (s of processor time per tick, bytes per tick of the .mcap file).

    csv : whether a CSV file is written as well
    compression : compression of the .mcap file
    """
    sink = {"service": "csv", "path": "csv", "parameters": {}, "columns": columns()}
    with tempfile.TemporaryDirectory() as folder:
        plan = {
            "name": "bench",
            "stem": "bench",
            "folder": folder,
            "rate": RATE,
            "duration": None,
            "virtual": True,
            "simulated": True,
            "compression": compression,
            "signals": columns(),
            "buses": ["legs"],
            "sinks": [sink] if csv else [],
            "status_line": False,
        }
        shared = SharedState(1 << 20)
        recording = Recording(plan, shared)
        recording.open()
        recording.begin()
        spent = 0.0
        for first in range(0, ticks, FLUSH_TICKS):
            for tick in range(first, first + FLUSH_TICKS):
                for kind, payload in tick_records(tick):
                    shared.push(kind, payload)
            start = time.process_time()
            recording.take(read(shared))
            recording.flush()
            shared.release()
            spent += time.process_time() - start
        recording.finish(False)
        size = os.path.getsize(os.path.join(folder, "bench.mcap"))
    return spent / ticks, size / ticks
