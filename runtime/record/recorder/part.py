"""One part of a recording: passes records of the ring to the services of sinks and logs, and writes the sidecar.

A service that fails is stopped and reported; the others continue.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from cext.memory.shared_state import RECORD_CHANGE, RECORD_EVENT
from cext.recording.ring_batch import Batch
from runtime.host.console.styles import Console
from runtime.host.live import table
from runtime.host.system import name_process
from runtime.record.recorder.plugins import LOGS, SERVICES
from runtime.record.recorder.report import STILL_RECORDING, describe, outcome, reason, write_json
from runtime.record.recorder.service import Service, takes
from runtime.record.report.preflight import text as preflight
from runtime.record.storage import files, provenance
from runtime.record.storage.changes import Changes
from runtime.record.storage.format import row_struct
from runtime.record.storage.repair import Backlog

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.record.recorder.plan_types import Plan, PlanBefore, PlanSink

SIDECAR_EVENT_LIMIT = 100_000


class RecordingFailed(Exception):
    """The files cannot be created. The text is the reason in one line."""


class Recording:
    """One part of a recording.

    plan : as runtime.record.recorder describes it
    shared : cext.memory.shared_state.SharedState
    part : 1; 2, 3, ... after the death of a writer
    say : function that prints a line on the terminal
    """

    def __init__(self, plan: Plan, shared: SharedState) -> None:
        self.plan, self.shared = plan, shared
        self.part = plan.get("part", 1)
        before: PlanBefore | None = plan.get("before")
        self.row = row_struct(len(plan["signals"]))
        self.ticks, self.first_tick = 0, None
        self.last_tick, self.time = None, 0.0
        self.events, self.events_left_out, self.end = [], 0, None
        self.changes = Changes(table.read(shared).parameters)
        self.newest = None  # the newest row: tick, lateness, values
        self.traffic = [0] * len(plan["buses"])  # frames of each bus, received or sent
        self.bits = [0] * len(plan["buses"])  # how many bits of its bitrate these frames last
        self.ratios: list[float] = []  # `rate_ratios` if `bits` is needed
        self.services = []  # (path, service) of the running ones
        self.about = {}
        self.sidecar = None
        self.files, self.saved, self.folders = {}, {}, []
        self.later: list[tuple[str, Callable[[], Any]]] = []  # what completes files after the report, by its service
        self.sinks, self.problems = {}, [*before["problems"]] if before else []
        self.say: Callable[[str], bool | None] = lambda line: None
        self.console = Console()
        self.question, self.shown_at = 0, 0  # newest question to the operator that was shown; ns of CLOCK_MONOTONIC
        self.unshown = None  # event with a question that the terminal has not taken
        self.before = before["files"] if before else {}  # {path: remark}
        self.backlog = Backlog(before["logs"] if before else [])  # the incomplete flight logs of earlier parts
        if before:
            self.events.append({"event": "recorder", "part": self.part, "dropped": before["lost"]})

    def open(self) -> None:
        """Create the folder and every file. Raises RecordingFailed and then leaves no file."""
        problem = f"cannot record into {self.plan['folder']!r}"
        try:
            if self.plan["folder"] is not None:
                self.open_folder(self.plan["folder"])
            for sink in self.plan["sinks"]:
                problem = f"{sink['path']} cannot start"
                try:
                    self.start(SERVICES.load(sink["service"]), sink)
                except Exception as error:
                    if self.part == 1:
                        raise
                    self.leave_out(sink["path"], error)
            for name in LOGS if self.plan["folder"] is not None else ():
                problem = f"the {name} log cannot start"
                kind = SERVICES.load(name)
                if kind.applies(self.plan):
                    problem = f"the {kind.title} cannot start"
                    self.start(kind, {"service": name, "path": kind.title, "columns": [], "parameters": {}})
        except Exception as error:  # a service can be of any package
            self.discard()
            raise RecordingFailed(f"{problem}: {reason(error)}") from error

    def start(self, kind: type[Service], sink: PlanSink) -> None:
        """Create and open a service."""
        service = kind(self.plan, sink)
        service.say, service.record, service.shared = self.say_later, self.take_event, self.shared
        self.services.append((sink["path"], service))
        service.open()

    def leave_out(self, path: str, error: Exception) -> None:
        """Leave out a service that cannot start in a later part, for example because its viewer was closed."""
        for entry in [entry for entry in self.services if entry[0] == path]:
            self.services.remove(entry)
            self.files.update({file: files.INCOMPLETE for file in entry[1].files})
        self.problems.append(f"{path} cannot be continued: {reason(error)}")
        self.sinks[path] = {"failed": self.problems[-1]}

    def say_later(self, line: str) -> None:
        """Call `say`, which is set after the files are open."""
        self.say(line)

    def open_folder(self, folder: str) -> None:
        """Create the folder, and the sidecar, which reserves the stem of the file names."""
        self.folders = files.make_folder(folder)
        self.plan["stem"], self.sidecar, descriptor = files.reserve(folder, self.plan["stem"])
        self.files[self.sidecar] = "description and report of the run"
        with open(descriptor, "w") as file:
            json.dump({"name": self.plan["name"], "ended": STILL_RECORDING}, file)

    def begin(self) -> None:
        """Gather the provenance and begin the services, while the control process continues."""
        self.about = provenance.gather(self.plan)
        if self.sidecar is not None:
            with suppress(OSError):  # a deleted folder or a full disk: `finish` reports it
                self.write_sidecar({"name": self.plan["name"], "ended": STILL_RECORDING, **self.about})
        for _, service in list(self.services):
            self.attempt(service, lambda: service.begin(self.about))

    def write_sidecar(self, content: dict[str, Any]) -> None:
        """Replace the sidecar. Raises OSError."""
        assert self.sidecar is not None
        write_json(self.sidecar, content, durable=not self.plan["virtual"])

    def take(self, records: list[Any]) -> None:
        """Pass records to the services. records : as cext.recording.ring_batch.read returns them"""
        if self.unshown is not None:
            self.show(self.unshown)
        for item in records:
            if isinstance(item, Batch):
                self.take_batch(item)
                continue
            kind, payload = item
            if kind == RECORD_EVENT:
                self.take_event(json.loads(payload))
            elif kind == RECORD_CHANGE:
                for event in self.changes.events(payload):
                    self.take_event(event)

    def take_batch(self, batch: Batch) -> None:
        """Pass rows, frames and drains to the services."""
        if batch.rows:
            self.newest = newest = batch.newest()
            assert newest is not None
            if self.ticks == 0:
                self.first_tick = batch.first_tick()
            self.last_tick = int(newest[0])
        batch.add_traffic(self.traffic, self.bits, self.ratios)
        for _, service in list(self.services):
            try:
                service.records(batch)
            except Exception as error:
                self.stop(service, error)
        self.ticks += batch.rows
        self.time = (self.last_tick or 0) / self.plan["rate"]

    def show(self, event: dict[str, Any]) -> None:
        """Print the lines of an event on the terminal; a question again until the terminal takes it."""
        shown = True
        if event.get("event") == "preflight":
            for line in preflight.text(event, self.console):
                shown = self.say(line) is not False and shown
        for line in event.get("lines", ()):
            shown = self.say(line) is not False and shown
        if "question" not in event:
            return
        if shown:
            self.unshown, self.question, self.shown_at = None, event["question"], time.monotonic_ns()
        else:
            self.unshown = event

    def take_event(self, event: dict[str, Any]) -> None:
        """Show an event, keep it for the sidecar and pass it to the services."""
        self.show(event)
        if event.get("event") == "end":
            self.end = event
        elif len(self.events) < SIDECAR_EVENT_LIMIT:
            self.events.append(event)
            if event.get("event") == "warning":
                self.say(f"tickwork: {event['device']} at tick {event['tick']}: {event['what']}")
        else:
            self.events_left_out += 1
        for _, service in list(self.services):
            self.attempt(service, lambda: service.event(event))

    def flush(self) -> None:
        """Flush the files of all services."""
        for _, service in list(self.services):
            self.attempt(service, service.flush)
        self.stop_deleted()

    def stop_deleted(self) -> None:
        """Stop the services whose files were deleted."""
        for _, service in list(self.services):
            gone = [] if service.elsewhere else [file for file in service.files if not os.path.exists(file)]
            if gone:
                self.stop(service, OSError(0, "its file was deleted", gone[0]))

    def sizes(self) -> dict[str, int]:
        """Return {path: bytes} of every file that this process writes, as on the disk."""
        others = {
            self.sidecar,
            *self.before,
            *(path for _, service in self.services if service.elsewhere for path in service.files),
        }
        return {
            entry["path"]: os.path.getsize(entry["path"])
            for entry in self.list_files()
            if entry["path"] not in others and os.path.exists(entry["path"])
        }

    def checkpoint(self) -> dict[str, Any]:
        """Return the state for the next part, should this process die: a dict for JSON."""
        return {
            "sizes": self.sizes(),
            "files": self.described_files(),
            "stem": self.plan["stem"],
            "sidecar": self.sidecar,
            "kept": {path: service.kept for path, service in self.services if service.kept},
            "log": next((service.unfinished for _, service in self.services if service.unfinished), None),
        }

    def attempt(self, service: Service, action: Callable[[], Any]) -> Any:
        """Call a method of a service. Returns its result; stops the service and returns None if it raises."""
        try:
            return action()
        except Exception as error:
            self.stop(service, error)
            return None

    def stop(self, service: Service, error: Exception) -> None:
        """Stop a failed service, keep its files and report the problem."""
        if all(other is not service for _, other in self.services):
            return
        path = next(path for path, other in self.services if other is service)
        self.services = [entry for entry in self.services if entry[1] is not service]
        problem = f"{path} stopped at {service.time or self.time:g} s: {reason(error)}"
        with suppress(Exception):  # the first failure is reported
            service.close()
        self.sinks[path] = {"failed": problem}
        self.files.update({file: remark_on(file) for file in service.files})
        self.problems.append(problem)
        self.say(f"tickwork recorder: {problem}; the run continues")

    def finish(self, orphaned: bool) -> dict[str, Any]:
        """Close all services and write the sidecar. Returns the report."""
        for service in [service for _, service in self.services if takes(service, "end")]:
            self.attempt(service, lambda: service.end(outcome(self, orphaned)))
        self.stop_deleted()
        for path, service in list(self.services):
            result = self.attempt(service, service.close) or {}
            if path not in self.sinks:
                self.sinks[path] = result
                if result.get("problem"):
                    self.problems.append(result["problem"])
                self.files.update(service.files)
        self.problems += self.backlog.finish()
        report = {"strides": []}
        plan = {**self.plan, "stopped": bool(self.end and self.end.get("signal"))}
        for kind in dict.fromkeys(type(service) for _, service in self.services):
            together = [service for _, service in self.services if type(service) is kind]
            try:
                result = kind.conclude(plan, together)
                if "later" in result:
                    self.later.append((kind.__name__, result.pop("later")))
                    if self.plan["virtual"]:
                        self.later.pop()[1]()
            except Exception as error:
                self.problems.append(f"{kind.__name__}: {reason(error)}")
                continue
            self.files.update(result.pop("files", {}))
            report.update(result)
        report = {**describe(self, orphaned), **report}
        if self.sidecar is not None:
            try:
                self.write_sidecar(report)
            except OSError as error:
                self.problems.append(f"{self.sidecar}: {reason(error)}")
                self.files[self.sidecar] = remark_on(self.sidecar)
                report["files"] = self.list_files()
        return report

    def complete_later(self) -> int | None:
        """Complete files in a new process, which no other one waits for. Returns its ID; None without such files."""
        pid = os.fork() if self.later else None
        if pid != 0:
            return pid
        try:
            os.closerange(3, os.sysconf("SC_OPEN_MAX"))  # others wait until pipes hang up
            name_process("tickwork-draw")
            for name, complete in self.later:
                try:
                    complete()
                except Exception as error:
                    self.say(f"tickwork recorder: {name}: {reason(error)}")
        finally:
            os._exit(0)

    def described_files(self) -> dict[str, str]:
        """Return {path: remark} of every file, the sidecar last."""
        known = {
            **self.before,
            **self.files,
            **{path: note for _, service in self.services for path, note in service.files.items()},
            **self.saved,
        }
        if self.sidecar is not None:
            known[self.sidecar] = known.pop(self.sidecar)
        return known

    def list_files(self) -> list[dict[str, str]]:
        """Return every file as the report lists it."""
        return [{"path": path, "note": note} for path, note in self.described_files().items()]

    def discard(self) -> None:
        """Remove all files and folders of this recording."""
        for _, service in self.services:
            with suppress(Exception):  # the file is removed below
                service.discard()
        for file in self.list_files():
            with suppress(FileNotFoundError):
                os.unlink(file["path"])
        with suppress(OSError):  # another process uses the folder
            for folder in reversed(self.folders):
                os.rmdir(folder)


def remark_on(file: str) -> str:
    """Return the remark on a file that ended before the recording."""
    return files.INCOMPLETE if os.path.exists(file) else files.DELETED
