"""The writer process: drains the ring into one part of a recording, completes the files and reports.

It outlives the control process and writes all records that were in the ring when that died.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cext.memory.shared_state import SharedState
from cext.recording.ring_batch import read
from cext.safety.thresholds import GUARDIAN_DEATH
from runtime.host.console.keys import Keyboard
from runtime.host.console.stderr import Terminal
from runtime.host.console.styles import Console
from runtime.host.system import name_process
from runtime.record.recorder.checkpoint import Checkpoint
from runtime.record.recorder.companion import Companion
from runtime.record.recorder.disk_sync import DiskSync
from runtime.record.recorder.panel import Panel
from runtime.record.recorder.part import Recording, RecordingFailed
from runtime.record.recorder.status import StatusLine
from runtime.record.storage.format import rate_ratios

if TYPE_CHECKING:
    from runtime.record.recorder.plan_types import Plan

POLL_PERIOD = 20  # ms, of the ring in real time
POLL_PERIOD_VIRTUAL = 1  # ms; a loop in virtual time waits for the writer
FLUSH_PERIOD = 0.5  # s
# of a flush in virtual time, so that the files of two equal runs are flushed at the same rows
FLUSH_ROWS, FLUSH_SIZE = 250, 128 << 10  # rows; bytes
UNLIMITED = 1 << 62
# fractions of the ring; a flush is due when more than this is not released. In virtual time the rows decide, if the
# ring has space for so many: when records are read depends on the scheduler
FLUSH_SHARE, FLUSH_SHARE_VIRTUAL = 0.25, 0.5


def write(shared: SharedState, answers: int, control: Any, companion: int, plan: Plan, checkpoint: Checkpoint) -> None:
    """Record one part, from opening its files to its report.

    Raises RecordingFailed if the files of a later part cannot be created; part 1 reports that to the control process.
    """
    recording = Recording(plan, shared)
    try:
        with discarded_on_signal(recording):
            recording.open()
    except RecordingFailed as error:
        if "before" in plan:
            raise
        answer(answers, {"error": str(error)})
        return
    terminal = Terminal()
    recording.say, recording.console = (
        terminal.say,
        Console(terminal.columns if terminal.interactive else None, terminal.coloured),
    )
    control.look(0)
    if control.abandoned:
        recording.discard()
        return
    checkpoint.save(recording.checkpoint())
    name_process("tickwork-record")
    if "before" not in plan:
        answer(answers, {"ready": True, "files": recording.list_files()})
    beside = Companion(companion, recording, shared, control.pidfd) if companion >= 0 else None
    record(shared, answers, control, beside, recording, terminal, checkpoint)


@contextmanager
def discarded_on_signal(recording: Recording) -> Iterator[None]:
    """Remove the recording and end the process on SIGTERM, which the control process sends if it ends before the run.

    Opening the files can take long, on a slow disk or for a viewer, and the services are any package's: the handler
    raises no exception, which they could swallow.
    """

    def discard(number, frame):
        recording.discard()
        os._exit(0)

    if "before" in recording.plan:  # a later part: the run has begun
        yield
        return
    signal.signal(signal.SIGTERM, discard)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def record(
    shared: SharedState,
    answers: int,
    control: Any,
    companion: Companion | None,
    recording: Recording,
    terminal: Terminal,
    checkpoint: Checkpoint,
) -> None:
    """Drain the ring until the run is over, then complete the recording and send the report."""
    plan = recording.plan
    recording.begin()
    panel = Panel(shared, Keyboard(shared), recording, companion) if plan.get("keys") else None
    status = StatusLine(terminal, plan, shared, panel, recording)
    recording.ratios = rate_ratios(plan) if status.enabled else []
    sync = DiskSync(recording.sizes()) if plan["folder"] is not None and not plan["virtual"] else None
    try:
        drain(
            shared,
            control,
            recording,
            status,
            panel,
            companion,
            checkpoint,
            POLL_PERIOD_VIRTUAL if plan["virtual"] else POLL_PERIOD,
        )
    finally:
        if sync is not None:
            sync.stop()
    if control.abandoned or (control.gone and not shared.wall):  # the run has not started
        recording.discard()
        return
    orphaned = not shared.closed
    status.complete(recording.end)
    report = recording.finish(orphaned)
    status.erase()
    if orphaned:
        terminal.say(orphan_line(report, cause_of_death(shared, plan["items"])))
    answer(answers, {**report, "completing": recording.complete_later()})


def drain(
    shared: SharedState,
    control: Any,
    recording: Recording,
    status: StatusLine,
    panel: Panel | None,
    companion: Companion | None,
    checkpoint: Checkpoint,
    idle: float,
) -> None:
    """Drain the ring into the recording until the end of the run."""
    flush_at = 0.0
    virtual = recording.plan["virtual"]
    per_flush = max(1, min(FLUSH_ROWS, FLUSH_SIZE // recording.row.size))
    flushed = recording.ticks
    while True:
        # read before the drain: all earlier records are then in the ring
        over = shared.closed or (control.gone and not is_guarded(shared))
        rows = flushed + per_flush - recording.ticks if virtual else UNLIMITED
        records = read(shared, rows)
        recording.take(records)
        if companion is not None:
            companion.take(records, recording.plan["rate"])
            companion.look()
        now = time.monotonic()
        due = recording.ticks - flushed >= per_flush if virtual else now >= flush_at
        if due or shared.held > (FLUSH_SHARE_VIRTUAL if virtual else FLUSH_SHARE):
            recording.flush()
            checkpoint.save(recording.checkpoint())
            flush_at, flushed = now + FLUSH_PERIOD, recording.ticks
        if panel is not None and not over:
            panel.look(now)
        if panel is None or panel.keyboard.in_foreground:
            status.update(now)
        if records and (virtual or over):
            continue
        if over or control.abandoned:
            return
        recording.backlog.look()
        control.look(idle)


def is_guarded(shared: SharedState) -> bool:
    """Return whether a guardian runs, which reports its stop after the death of the control process."""
    return time.monotonic_ns() - shared.guarded < GUARDIAN_DEATH


def cause_of_death(shared: SharedState, items: list[str]) -> str:
    """Return how a control process died before the end of its run: by a signal of its own, or in which state.

    Its exit code is only available to its parent process.

    items : names of the stopwatch items, as in cext.clock.stopwatch.names
    """
    if shared.crashed:
        hung = shared.hung or -1
        block = f" in {items[hung]}" if hung >= 0 else ""
        return f"of {signal.Signals(shared.crashed).name}{block}"
    tick = shared.statistics()["last_tick"]
    block = f"in {items[shared.at]} " if shared.state == "running" and shared.at >= 0 else ""
    if block and shared.in_run:  # the step is not stored while machine code runs
        block = f"{block}or a native block after it, "
    where = {
        "init": "before arming",
        "arming": "while arming",
        "ready": "before it was armed",
        "stopping": "during the safe stop",
        "safe": "after the safe stop",
    }
    when = where.get(shared.state) or ("in its first tick" if tick < 0 else f"after tick {tick}")
    return f"{block}{when} without ending the run: it was killed, or a block called exit, os._exit or exec"


def orphan_line(report: dict[str, Any], cause: str) -> str:
    """Return the line for the terminal after the death of the control process."""
    files = ", ".join(file["path"] for file in report["files"]) or "no files"
    return (
        f"tickwork recorder: the control process died {cause}; {report['ticks']} ticks were recorded, the last is "
        f"{report['last_tick']}: {files}"
    )


def answer(descriptor: int, message: dict[str, Any]) -> None:
    """Send one line of JSON to the control process, if it still runs."""
    data = json.dumps(message).encode() + b"\n"
    try:
        while data:
            data = data[os.write(descriptor, data) :]
    except BrokenPipeError:
        pass
