"""The base class of services, which the recorder process calls: one class for each kind of sink, viewer or file format.

A Sink names its service: `service = "csv"`. Ours are in runtime.recorder.plugins. An installed package lists its own in
the entry-point group "tickwork.sinks":

    [project.entry-points."tickwork.sinks"]
    lsl = "mylab.lsl:LslSender"

and its Sink has `service = "lsl"`. A module on the path needs no entry point: `service = "mylab.lsl:LslSender"`.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from runtime.recording.format import row_struct

if TYPE_CHECKING:
    from cext.safety.shared_state import SharedState


class Service:
    """The base class of services: every method does nothing.

    The recorder calls them from one thread, in the order below. While one works the ring fills, and a full ring drops
    records: no method may block. A service that raises is stopped and reported; the run and the other services go on.

    plan : dict of the run, as runtime.recorder describes it; plan["stem"] is a file name that is free in
        plan["folder"], which is None where no files are written
    sink : dict of the sink: path, parameters, columns
    page : cext.safety.shared_state.SharedState of the run, set before `open`
    say : function that prints a line on the terminal, set before `open`
    files : {path: remark} of each file that the service has made
    """

    elsewhere = False  # whether another process writes its files
    time = 0.0  # s, of the newest row that `row` has taken
    unfinished = None  # path of a file that the next part completes, should the recorder process be killed

    def __init__(self, plan, sink):
        self.plan, self.sink = plan, sink
        self.files = {}
        self.say = lambda line: None
        self.page: SharedState | None = None

    @property
    def durable(self) -> bool:
        """Whether files wait for the disk when they are closed. A run in virtual time can be repeated instead."""
        return not self.plan["virtual"]

    @classmethod
    def applies(cls, plan) -> bool:
        """Return whether a recording with this plan needs the service. Called for logs, which no Sink names."""
        return True

    def epoch(self):
        """s since 1970 at tick 0, by the clock of the computer, once the first row has come."""
        return time.time() if self.page is None else (self.page.wall + self.page.first_tick) * 1e-9

    def open(self):
        """Create files, resolve hosts. An exception here prevents the run."""

    def begin(self, about):
        """Do what takes longer, such as imports: the run has been armed. about : dict, what the recording states"""

    def records(self, batch):
        """Take rows, frames and bus drains of the ring, in order. Calls the four methods below for each of them.

        batch : cext.safety.ring_batch.Batch
        """
        # not at the top: `convert` writes CSV files without compiled modules
        from cext.safety.shared_state import RECORD_FRAME, RECORD_RECEIVED, RECORD_ROW

        methods = {RECORD_ROW: ("row", "every_signal"), RECORD_FRAME: ("frame",), RECORD_RECEIVED: ("received",)}
        kinds = {kind for kind, names in methods.items() if any(takes(self, name) for name in names)}
        if not kinds:
            return
        unpack = row_struct(len(self.plan["signals"])).unpack
        for kind, payload in batch:
            if kind not in kinds:
                continue
            if kind == RECORD_FRAME:
                self.frame(payload)
            elif kind == RECORD_RECEIVED:
                self.received(payload)
            else:
                tick, lateness, *values = unpack(payload)
                time = int(tick) / self.plan["rate"]
                self.every_signal(int(tick), time, lateness, values)
                self.row(int(tick), time, [values[column["index"]] for column in self.sink["columns"]])
                self.time = time

    def row(self, tick, time, values):
        """Take the columns of the sink in one completed tick. time : s; values : floats, in the order of the columns"""

    def every_signal(self, tick, time, lateness, values):
        """Take all recorded signals of one completed tick. lateness : s; values : floats in the order of
        plan["signals"]
        """

    def received(self, payload):
        """Take the time at which the buses were read: 8 bytes, ns since the run's begin. The frames follow."""

    def frame(self, payload):
        """Take a frame of a bus. payload : bytes of a struct Frame, see runtime.recording.format"""

    def event(self, event):
        """Take an event, such as a live change or a mark: a dict, as the sidecar file has it."""

    def flush(self):
        """Flush files. Called at least once a second, and before `close`."""

    def end(self, report):
        """Write what is known at the end. report : dict"""

    def close(self):
        """Close files. Returns what the report contains about this sink, a dict for JSON; its "problem" is printed."""
        return {}

    @classmethod
    def conclude(cls, plan, services):
        """Summarize all closed services of this class. Returns a dict for the report; its "files" as above.

        plan : as above, with "stopped": whether a signal has ended the run, which then has to end within 100 ms
        """
        return {}


def takes(service, method):
    """Whether a service has a method of its own."""
    return getattr(type(service), method) is not getattr(Service, method)
