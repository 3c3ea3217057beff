"""Base class of the services of the recorder process: one class per kind of sink, viewer or file format.

A Sink names its service: `service = "csv"` is SERVICE of the module runtime.record.recorder.services.csv. An installed
package lists its services in the entry-point group "tickwork.sinks":

    [project.entry-points."tickwork.sinks"]
    lsl = "mylab.lsl:LslSender"

and its Sink has `service = "lsl"`. A module on the path needs no entry point: `service = "mylab.lsl:LslSender"`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

from runtime.record.storage.format import row_struct

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.record.recorder.plan_types import Plan, PlanSink


class Service:
    """Base class of services, whose methods do nothing.

    The recorder calls them from one thread, in the order below. While one runs the ring fills, and a full ring drops
    records: no method may block. A service that raises is stopped and reported, while the run and the other services
    continue.

    plan : dict of the run, as runtime.record.recorder describes it; plan["stem"] is a file name that is free in
        plan["folder"], which is None if no files are written
    sink : dict of the sink: path, parameters, columns, every
    shared : cext.memory.shared_state.SharedState of the run, set before `open`
    say : function that prints a line on the terminal, set before `open`
    record : function that adds an event to the recording, set before `open`
    files : {path: remark} of each file that the service has created
    """

    title = ""  # of a log, in messages
    elsewhere = False  # whether another process writes its files
    time = 0.0  # s, of the newest row that `row` has taken
    kept: dict[str, Any] = {}  # for JSON: what the service of the next part finds in `before`

    def __init__(self, plan: Plan, sink: PlanSink) -> None:
        self.plan, self.sink = plan, sink
        self.files: dict[str, str] = {}
        self.say: Callable[[str], None] = lambda line: None
        self.record: Callable[[dict[str, Any]], None] = lambda event: None
        self.shared: SharedState | None = None

    @property
    def before(self) -> dict[str, Any]:
        """`kept` of this service in the part before this one; empty in the first part."""
        return self.plan.get("before", {}).get("kept", {}).get(self.sink["path"], {})

    @property
    def unfinished(self) -> str | None:
        """Path of a file that the next part completes, should the recorder process be killed; None without one."""
        return None

    @property
    def stem(self) -> str:
        """Path of the files of the recording, without a suffix."""
        return os.path.join(self.plan["folder"] or "", self.plan["stem"])

    @property
    def durable(self) -> bool:
        """Whether `close` waits for the disk. A run in virtual time can be repeated instead."""
        return not self.plan["virtual"]

    @classmethod
    def applies(cls, plan: Plan) -> bool:
        """Return whether a recording with this plan needs the service. Called for logs, which no Sink names."""
        return True

    def epoch(self) -> float:
        """Return the time of tick 0 in s since 1970, by the clock of the computer. Valid once a row has been taken."""
        return time.time() if self.shared is None else (self.shared.wall + self.shared.first_tick) * 1e-9

    def open(self) -> None:
        """Create files, resolve hosts. An exception here prevents the run."""

    def begin(self, about: dict[str, Any]) -> None:
        """Do what takes longer, such as imports, while the run is armed. about : metadata of the recording"""

    def records(self, batch: Any) -> None:
        """Take rows, frames and bus drains of the ring, in order. Calls the four methods below for each of them.

        batch : cext.recording.ring_batch.Batch
        """
        if not self._takers:
            return
        for kind, payload in batch:
            taker = self._takers.get(kind)
            if taker is not None:
                taker(payload)

    @cached_property
    def _takers(self) -> dict[int, Callable[[bytes], None]]:
        """{kind of a record: function that takes its payload}, of those that the class takes"""
        # not at the top: `convert` writes CSV files without compiled modules
        from cext.memory.shared_state import RECORD_FRAME, RECORD_RECEIVED, RECORD_ROW

        unpack = row_struct(len(self.plan["signals"])).unpack

        def take_row(payload: bytes) -> None:
            number, lateness, *values = unpack(payload)
            tick, time = int(number), int(number) / self.plan["rate"]
            self.every_signal(tick, time, lateness, values)
            self.row(tick, time, [values[column["index"]] for column in self.sink["columns"]])
            self.time = time

        known: dict[int, tuple[Callable[[bytes], None], tuple[str, ...]]] = {
            RECORD_ROW: (take_row, ("row", "every_signal")),
            RECORD_FRAME: (self.frame, ("frame",)),
            RECORD_RECEIVED: (self.received, ("received",)),
        }
        return {kind: taker for kind, (taker, names) in known.items() if any(takes(self, name) for name in names)}

    def row(self, tick: int, time: float, values: list[float]) -> None:
        """Take the columns of the sink in one completed tick.

        time : s
        values : values in the order of the columns
        """

    def every_signal(self, tick: int, time: float, lateness: float, values: list[float]) -> None:
        """Take all recorded signals of one completed tick.

        time, lateness : s
        values : values in the order of plan["signals"]
        """

    def received(self, payload: bytes) -> None:
        """Take the time of a bus drain: 8 bytes, ns since the start of the run. Its frames follow."""

    def frame(self, payload: bytes) -> None:
        """Take a frame of a bus. payload : bytes of a struct Frame, see runtime.record.storage.format"""

    def event(self, event: dict[str, Any]) -> None:
        """Take an event, such as a live change or a mark, as in the sidecar file."""

    def flush(self) -> None:
        """Flush files. Called at least once a second, and before `close`."""

    def end(self, report: dict[str, Any]) -> None:
        """Write the report of the run, at its end."""

    def discard(self) -> None:
        """Close, before the files are removed, as the run was refused."""
        self.close()

    def close(self) -> dict[str, Any]:
        """Close files. Returns the part of the report about this sink, for JSON; its "problem" is printed."""
        return {}

    @classmethod
    def conclude(cls, plan: Plan, services: list[Any]) -> dict[str, Any]:
        """Summarize all closed services of this class. Returns a dict for the report; its "files" as above.

        Its "later" is a function that completes these files, such as pictures. A process of its own calls it after the
        report; in virtual time the recorder does so before.

        plan : as above, with "stopped": whether a signal has ended the run, which must then end within 100 ms
        """
        return {}


def takes(service: Service, method: str) -> bool:
    """Return whether the class of a service overrides a method."""
    return getattr(type(service), method) is not getattr(Service, method)
