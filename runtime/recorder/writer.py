"""The process that writes: drains the ring into one part of a recording until the run is over, finishes the files, and
reports.

It outlives the control process: whatever had reached the ring when that died is written.
"""

import json
import os
import signal
import time

from cext.safety.thresholds import GUARDIAN_DEATH
from runtime.console.keys import Keyboard, attributes_of, put_back
from runtime.console.stderr import Terminal
from runtime.console.styles import Console
from runtime.recorder.panel import Panel
from runtime.recorder.recording import Recording, RecordingFailed
from runtime.recorder.status import StatusLine

BATCH = 4096  # records taken out of the ring at once
IDLE = 5  # ms between looks at an empty ring
IDLE_VIRTUAL = 1  # ms; a loop in virtual time waits for us
FLUSH = 0.5  # s between flushes at most,
HELD = 0.25  # or this share of the ring that waits for one
FOLLOW = 0.1  # s between looks at who has the terminal


def write(page, answers, control, keys, plan, checkpoint):
    """One part, from opening its files to its report. RecordingFailed, of a part behind the first, where its files
    cannot be made
    """
    recording = Recording(plan, page)
    try:
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
    before = attributes_of(keys) if keys >= 0 else None
    checkpoint.save(recording.checkpoint())
    name_process("tickwork-record")
    if "before" not in plan:
        answer(answers, {"ready": True, "files": recording.list_files()})
    try:
        record(page, answers, control, keys, recording, terminal, checkpoint)
    finally:
        if before is not None:  # whoever had changed the terminal may have been killed, and the run with it
            put_back(keys, before)


def record(page, answers, control, keys, recording, terminal, checkpoint):
    """Ring to recording, until the run is over; then the end of the recording, and the report."""
    plan = recording.plan
    recording.begin()
    answered = keys >= 0 and plan["status_line"] and plan.get("keys", True) and terminal.interactive
    panel = Panel(page, Keyboard(keys, page.control), recording) if answered else None
    status = StatusLine(terminal, plan, page, panel, recording)
    try:
        drain(page, control, recording, status, panel, checkpoint, IDLE_VIRTUAL if plan["virtual"] else IDLE)
    finally:
        if panel is not None:
            panel.close()
    if control.abandoned or (control.gone and not page.wall):  # nothing has begun
        recording.discard()
        return
    orphaned = not page.closed
    report = recording.finish(orphaned)
    status.erase()
    if orphaned:
        terminal.say(orphan_line(report, cause_of_death(page)))
    answer(answers, report)


def drain(page, control, recording, status, panel, checkpoint, idle):
    """Ring to recording, until nothing more will come."""
    flush_at = follow_at = 0.0
    while True:
        # asked first: what was pushed before is then in the ring
        over = page.closed or (control.gone and not guarded(page))
        records = page.drain(BATCH, release=False)
        recording.take(records)
        now = time.monotonic()
        if now >= flush_at or page.held > HELD:
            recording.flush()
            checkpoint.save(recording.checkpoint())
            flush_at = now + FLUSH
        if panel is not None and not over:
            if now >= follow_at:
                panel.keyboard.follow()
                follow_at = now + FOLLOW
            panel.look(now)
        if panel is None or panel.keyboard.here:
            status.update(now)
        if records:
            continue
        if over or control.abandoned:
            return
        recording.backlog.look()
        control.look(idle)


def guarded(page):
    """Whether a guardian is at work, which reports what it has done after the control process has died."""
    return time.monotonic_ns() - page.guarded < GUARDIAN_DEATH


def cause_of_death(page):
    """What the page shows of a control process that died before the end of its run: the signal that killed it from
    within, or where it was.

    Its exit code goes to the process that started it, and to no other.
    """
    if page.crashed:
        return f"of {signal.Signals(page.crashed).name}"
    tick = page.statistics()["last_tick"]
    where = {
        "init": "before arming",
        "arming": "while arming",
        "ready": "before it was armed",
        "stopping": "during the safe stop",
        "safe": "after the safe stop",
    }
    when = where.get(page.state) or ("in its first tick" if tick < 0 else f"after tick {tick}")
    return f"{when} without ending the run: it was killed, or a block called os._exit or exec"


def orphan_line(report, cause):
    files = ", ".join(file["path"] for file in report["files"]) or "no files"
    return (
        f"tickwork recorder: the control process died {cause}; {report['ticks']} ticks were recorded, the last is "
        f"{report['last_tick']}: {files}"
    )


def answer(descriptor, message):
    """One line of JSON to the control process, if it still listens."""
    data = json.dumps(message).encode() + b"\n"
    try:
        while data:
            data = data[os.write(descriptor, data) :]
    except BrokenPipeError:
        pass


def name_process(name):
    with open("/proc/self/comm", "w") as file:
        file.write(name)
