"""Recorder inside the control process, for runs in virtual time without files and viewers.

It has the interface of runtime.record.recorder.RecorderProcess. The executor calls `drain` whenever the ring is full,
and several times a second: the run waits for nothing, and no other process is started.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from cext.memory.shared_state import RECORD_CHANGE, RECORD_EVENT
from cext.recording.ring_reader import take
from runtime.host.console.stderr import Terminal
from runtime.host.live import table
from runtime.record.recorder.report import ending
from runtime.record.recorder.services.strides import StrideAverage
from runtime.record.recorder.status import StatusLine
from runtime.record.storage.changes import Changes

if TYPE_CHECKING:
    from runtime.record.recorder.plan_types import Plan


class LocalRecorder:
    """Status line, events and average strides of a run in this process.

    shared : cext.memory.shared_state.SharedState
    receive : called with each block: rows, sent frames, rows before each frame, as in cext.recording.ring_reader.take
    """

    lifeline = -1  # no other process reads the ring
    pid = None

    def __init__(self, shared, receive=lambda rows, sent, before: None):
        self.shared, self.receive = shared, receive
        self.changes = Changes(table.read(shared).parameters)
        self.events, self.end = [], None

    def configure(self, plan: Plan) -> None:
        """Begin. plan : as runtime.record.recorder describes it, without files, and without sinks but "strides"."""
        self.plan = plan
        self.columns = len(plan["signals"])
        self.strides = []
        for sink in plan["sinks"]:
            service = StrideAverage(plan, sink)
            service.open()
            self.strides.append((service, [2 + column["index"] for column in sink["columns"]]))
        self.status = StatusLine(Terminal(), plan, self.shared)

    def drain(self) -> None:
        """Drain the ring."""
        rows, sent, before, others = take(self.shared, self.columns)
        self.receive(rows, sent, before)
        ticks = rows[:, 0].astype(np.int64)
        for service, places in self.strides:
            service.average.add(ticks, rows[:, places])
        for kind, payload in others:
            if kind == RECORD_CHANGE:
                self.events += self.changes.events(payload)
            elif kind == RECORD_EVENT:
                event = json.loads(payload)
                if event["event"] == "end":
                    self.end = event
                else:
                    self.events.append(event)
        self.status.update(time.monotonic())

    def make_room(self, seconds: float) -> bool:
        """Drain the ring. Returns True: there is room again."""
        self.drain()
        return True

    def finish(self) -> dict[str, Any]:
        """Return the report, after the end of the run."""
        self.drain()
        self.status.erase()
        services = [service for service, _ in self.strides]
        return {
            "files": [],
            "problems": [],
            "events": self.events,
            "sinks": {service.sink["path"]: service.close() for service in services},
            "ended": ending(self.end, False),
            **StrideAverage.conclude(self.plan, services),
        }

    def abandon(self) -> None:
        """Do nothing: there are no files."""

    def keep_to(self, processors: Iterable[int]) -> None:
        """Do nothing: there is no process to move."""
