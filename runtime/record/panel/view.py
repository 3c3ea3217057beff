"""What a page shows of a run, read from its shared state.

hello   once: name, signals, live parameters, limits
frame   30 times a second: doubles FRAME_HEAD, then the newest value of each recorded signal, then the smallest and
        the largest of its values since the frame before: first those that came earlier, then those that came later.
        A page that has the controls confirms each with its time, if a lost page is a stop
status  5 times a second, and at once when the state changes: JSON
event   each event of the recording: JSON
"""

from __future__ import annotations

import os
import struct
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import msgspec.json

from cext.memory.shared_state import STATES
from cext.recording.newest_row import NewestRow
from runtime.host.live import table
from runtime.record.analysis import names
from runtime.record.panel import access
from runtime.record.storage.format import rate_ratios

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState

FRAME_PERIOD = 1.0 / 30.0  # s
STATUS_PERIOD = 0.2  # s
RATE_WINDOW = 6  # statuses
EVENT_LIMIT = 200
FRAME_HEAD = struct.Struct("<ddd")  # tick, index of the state in STATES, time in µs of CLOCK_MONOTONIC
OVER = ("stopping", "safe")
ARMING = "disabled"  # name of the live parameter of a drive whose value false arms it again


class View:
    """One run, as pages show it.

    plan : of the recorder, with the keys that runtime.record.recorder.services.panel sends
    shared : cext.memory.shared_state.SharedState
    """

    def __init__(self, plan: dict[str, Any], shared: SharedState) -> None:
        self.plan, self.shared = plan, shared
        self.table = table.read(shared)
        # parameters that no page may change, because the page never arms
        self.withheld = {each.path for each in self.table.parameters if each.path.rpartition(".")[2] == ARMING}
        self.row = NewestRow(shared, len(plan["signals"]), rate_ratios(plan))
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENT_LIMIT)
        self.history: deque[tuple[float, ...]] = deque(maxlen=RATE_WINDOW)
        self.complete = False  # whether the recording is complete
        self.gone = False  # whether the control process has ended without ending the run

    def hello(self) -> dict[str, Any]:
        """Return what a page needs once, for JSON."""
        parameters = [
            {
                "path": each.path,
                "unit": each.unit,
                "dtype": each.dtype,
                "description": each.description,
                "built": each.built,
                "low": each.low,
                "high": each.high,
                "slew": finite(each.slew),
                "withheld": each.path in self.withheld,
            }
            for each in self.table.parameters
        ]
        signals = [
            {key: column[key] for key in ("path", "unit", "dtype", "labels")}
            | {"limits": self.plan["limits"].get(column["path"]), "hot": self.plan["hot"].get(column["path"])}
            for column in self.plan["signals"]
        ]
        return {
            "type": "hello",
            "run": access.derived(self.plan["secret"], "run"),
            "watch": "" if access.is_local(self.plan["host"]) else access.derived(self.plan["secret"], access.VIEW),
            "name": self.table.name,
            "rate": self.plan["rate"],
            "duration": self.plan["duration"],
            "simulated": self.plan["simulated"],
            "diagram": self.plan["drawing"],
            "phases": self.plan["phases"] or {},
            **{key: self.plan[key] for key in ("lost", "marks", "subject", "target", "stride")},
            "states": STATES,
            "signals": names.describe(signals),
            "parameters": names.describe(parameters),
        }

    def frame(self) -> tuple[int, bytes]:
        """Return the time in µs, and the newest values of all signals with their tick, -1 before the first."""
        now = time.monotonic_ns() // 1000
        self.row.look()
        state = STATES.index(self.shared.state)
        arrays = self.row.values, self.row.first, self.row.second
        head = FRAME_HEAD.pack(self.row.tick, state, now)
        return now, head + b"".join(array.astype("<f8").tobytes() for array in arrays)

    def status(self) -> dict[str, Any]:
        """Return state, statistics, live parameters and recording, for JSON."""
        shared, statistics = self.shared, self.shared.statistics()
        late = statistics["lateness"]
        frames = statistics["frames"]
        counts = (statistics["ticks"], statistics["busy"], *self.row.traffic.ravel().tolist())
        self.history.append((time.monotonic(), *counts))
        begin, end = self.history[0], self.history[-1]
        seconds = end[0] - begin[0]
        ticks, load, *traffic = [(b - a) / seconds if seconds else None for a, b in zip(begin[1:], end[1:])]
        return {
            "type": "status",
            "state": shared.state,
            "stopped_by": shared.stopped_by,
            "over": shared.closed or self.gone or shared.state in OVER,
            "gone": self.gone,
            "complete": self.complete,
            "time": (statistics["last_tick"] + 1) / self.plan["rate"],
            "ticks_per_second": ticks,
            "load": load,
            "buses": [
                {
                    "name": name,
                    "received": received,
                    "sent": sent,
                    "bits": bits,
                    "bitrate": self.plan["bitrates"].get(name),
                }
                for name, received, sent, bits in zip(self.plan["buses"], *(traffic[place::3] for place in range(3)))
            ],
            "late": [finite(late.get("p50")), finite(late.get("p99"))],
            "missed": statistics["missed"],
            "lost_replies": dict(zip(self.plan["drives"], shared.lost_replies(list(self.plan["drives"].values())))),
            "dropped": statistics["dropped"],
            "malformed": frames["malformed"],
            "live": [list(pair) for pair in table.values(shared, self.table.parameters)],
            "recording": self.recording(),
        }

    def recording(self) -> dict[str, Any] | None:
        """Return the name of the recording and the free bytes of its disk; None for a run that writes no files."""
        folder = self.plan["folder"]
        if folder is None:
            return None
        free = None
        with suppress(OSError):
            disk = os.statvfs(folder)
            free = disk.f_bavail * disk.f_frsize
        return {"name": self.plan["stem"], "folder": folder, "free": free}

    def take_event(self, event: dict[str, Any]) -> dict[str, Any] | None:
        """Keep an event of the recording. Returns it in the form for pages, None for one that they do not show."""
        kind = event.get("event")
        shown: dict[str, Any] = {"type": "event", "event": kind, "tick": event.get("tick"), "by": event.get("by")}
        if kind in ("set", "mark", "note"):
            shown |= {key: event[key] for key in ("path", "value", "from", "number", "text") if key in event}
        elif kind == "warning":
            shown["text"] = f"{event['device']}: {event['what']}"
        elif kind in ("end", "fault"):
            keys = ("status", "culprit", "report", "unconfirmed", "stopped", "lines")
            shown |= {key: event[key] for key in keys if key in event}
        elif kind in ("stop", "confirm", "rearm"):
            pass
        elif event.get("lines"):
            shown["text"] = " ".join(str(line) for line in event["lines"])
        else:
            return None
        self.events.append(shown)
        return shown


def finite(value: float | None) -> float | None:
    """Return a number, None for one that JSON cannot hold."""
    return value if value is not None and abs(value) < float("inf") else None


def encode(message: dict[str, Any]) -> str:
    """Return a message as JSON. Values that are not finite become null."""
    return msgspec.json.encode(message).decode()
