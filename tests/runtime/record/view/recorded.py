"""Recordings of two walking legs with marks, changes and a fault, and the process of `view` that shows them."""

import contextlib
import json
import math
import signal

from cext.memory.shared_state import RECORD_EVENT, SharedState
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink
from tests.runtime.runs import started

RATE = 200.0
LEG = ("gait.phase 1", "gait.walking 1 bool", "knee.position rad", "knee.velocity rad/s", "knee.torque N·m")
SIGNALS = (*(f"{side}/{entry}" for side in ("left", "right") for entry in LEG), "imu.temperature °C")
SLOW = len(SIGNALS) - 1  # place of the signal that is recorded at every SLOW_EVERY-th tick
SLOW_EVERY = 50
TORQUE = SIGNALS.index("left/knee.torque N·m")


def walk(ticks, stride=1.1, torque=5.0):
    """Rows of two legs half a stride apart; the torque is NaN or infinite for a while."""
    for tick in ticks:
        values = []
        for shift in (0.0, 0.5):
            phase = (tick / RATE / stride + shift) % 1.0
            speed = 2.0 * math.pi / stride * math.sin(2.0 * math.pi * phase)
            values += [
                phase,
                1.0,
                1.0 - math.cos(2.0 * math.pi * phase),
                speed,
                torque * math.sin(math.pi * phase) ** 2,
            ]
        values.append(30.0 + tick / 1000.0)
        if 300 <= tick < 340:
            values[TORQUE] = math.nan
        elif 400 <= tick < 420:
            values[TORQUE] = math.inf
        yield tick, *values


def recording(folder, stem, rows, events=(), **changed):
    """Write a recording. rows : of (tick, *values); events : dicts. Returns its path."""
    described = columns(*SIGNALS)
    described[SLOW]["every"] = SLOW_EVERY
    limits = {f"{side}/knee.torque": [-9.0, 9.0] for side in ("left", "right")}
    order = plan(folder, sink(CSV, stem, described), stem=stem, **{"limits": limits, **changed})
    records = [(RECORD_EVENT, json.dumps(event).encode()) for event in events]
    report = record(order, [*records, *(row(*values) for values in rows)], SharedState(1 << 23))
    return next(entry["path"] for entry in report["files"] if entry["path"].endswith(".mcap"))


def trial(folder, stem, mark=800, ticks=4000, **how):
    """A trial with a mark that has a note, and a change. Returns its path."""
    events = [
        {"event": "mark", "number": 1, "tick": mark, "by": "keys"},
        {"event": "note", "number": 1, "tick": mark, "by": "page 1", "text": "new shoes"},
        {"event": "set", "path": "left/law.gain", "value": 2.5, "from": 1.0, "tick": mark + 400, "by": "page 2"},
        {"event": "warning", "device": "left/knee", "what": "the motor is warm", "tick": mark + 600},
    ]
    return recording(folder, stem, walk(range(ticks), **how), events)


@contextlib.contextmanager
def viewing(folder, *words, options=("--no-browser",), **how):
    """The process of `view`. Yields (process, address of its page); ended by Ctrl-C, unless it has ended before."""
    with started("view", *words, *options, cwd=folder, **how) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)
