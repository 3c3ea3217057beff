"""The recorder process itself: gets its plan, drains the ring until the run is over, finishes the files, reports, ends.

It outlives the control process: whatever had reached the ring when that died is written. Signals do not end it; the end of
the control process does.
"""

import json
import os
import select
import signal
import time
from contextlib import suppress

from cext import realtime
from cext.page import Page
from cext.thresholds import GUARDIAN_DEATH

from runtime.recorder.keyboard import Keyboard, attributes_of, put_back
from runtime.recorder.panel import Panel
from runtime.recorder.recording import Recording, RecordingFailed
from runtime.recorder.status import StatusLine
from runtime.recorder.succession import Heir, Inherited, call_oneself
from runtime.recorder.terminal import Terminal
from runtime.telling.lines import Paper

ORDERS = 0                      # standard input
BATCH = 4096                    # records taken out of the ring at once
IDLE = 5                        # ms between looks at an empty ring
IDLE_VIRTUAL = 1                # ms; a loop in virtual time waits for us
FLUSH = 0.5                     # s between flushes at most,
HELD = 0.25                     # or this share of the ring that waits for one
FOLLOW = 0.1                    # s between looks at who has the terminal


class Control:
    """What the recorder knows of the control process: whether it lives, and what it says on our standard input.

    gone : it has ended
    abandoned : it wants no recording
    """

    def __init__(self, pidfd):
        self.pidfd = pidfd
        self.gone = self.abandoned = False
        self.heard = b""
        self.poll = select.poll()
        self.poll.register(pidfd, select.POLLIN)
        self.poll.register(ORDERS, select.POLLIN)

    def look(self, milliseconds=None):
        """Wait until something happens, but no longer than `milliseconds`."""
        for descriptor, _ in self.poll.poll(milliseconds):
            if descriptor == self.pidfd:
                self.gone = True
                self.poll.unregister(self.pidfd)
                continue
            data = os.read(ORDERS, 1 << 20)
            self.heard += data
            if not data:
                self.poll.unregister(ORDERS)
            self.abandoned = self.abandoned or self.heard.endswith(b"abandon\n")

    def plan(self):
        """The first order, or None if there will be none."""
        while b"\n" not in self.heard and not self.gone:
            self.look()
        line, _, self.heard = self.heard.partition(b"\n")
        return None if self.abandoned or self.gone else json.loads(line)


def main(answers, control, page, keys):
    """The process: file descriptors of the pipe for answers, a pidfd of the control process, of the page, and its terminal's or -1."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    be_ordinary()
    page, control = Page(fd=page), Control(control)
    plan = control.plan()
    if plan is None:
        return
    recording = Recording(plan, page)
    try:
        recording.open()
    except RecordingFailed as error:
        answer(answers, {"error": str(error)})
        return
    terminal = Terminal()
    recording.say, recording.paper = terminal.say, Paper(terminal.columns if terminal.interactive else None, terminal.coloured)
    before = attributes_of(keys) if keys >= 0 else None
    ready = {"ready": True, "files": recording.list_files()}
    while True:
        try:
            record(page, answers, control, keys, recording, terminal, ready)
            if before is not None:              # whoever had changed the terminal may have been killed, and the run with it
                put_back(keys, before)
            return
        except Inherited as death:              # we are the heir
            recording, ready = recording.next_part(death.will), None
            page.rewind()


def record(page, answers, control, keys, recording, terminal, ready):
    """Ring to recording, until the run is over; then the end of the recording, and the report. Raises Inherited in an heir that is needed."""
    plan = recording.plan
    heir = Heir(page, recording.sizes(), recording.states())
    call_oneself("tickwork-record")
    if ready is not None:
        answer(answers, ready)
    recording.begin()
    answered = keys >= 0 and plan["status_line"] and plan.get("keys", True) and terminal.interactive
    panel = Panel(page, Keyboard(keys, page.control), recording) if answered else None
    status = StatusLine(terminal, plan, page, panel, recording)
    try:
        heir = drain(page, control, recording, status, panel, heir, IDLE_VIRTUAL if plan["virtual"] else IDLE)
    finally:
        if panel is not None:
            panel.close()
    if control.abandoned or (control.gone and not page.wall):       # nothing has begun
        recording.discard()
        heir.dismiss()
        return
    orphaned = not page.closed
    report = recording.finish(orphaned)
    status.erase()
    if orphaned:
        terminal.say(orphan_line(report))
    answer(answers, report)
    heir.dismiss()


def drain(page, control, recording, status, panel, heir, idle):
    """Ring to recording, until nothing more will come. Returns the heir, which may be a new one."""
    flush_at = follow_at = 0.0
    while True:
        over = page.closed or (control.gone and not guarded(page))      # asked first: what was pushed before is then in the ring
        records = page.drain(BATCH, release=False)
        recording.take(records)
        now = time.monotonic()
        if now >= flush_at or page.held > HELD:
            recording.flush()
            if not heir.release(recording.sizes(), recording.states()):
                heir.bury()
                heir = Heir(page, recording.sizes(), recording.states())
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
            return heir
        recording.backlog.look()
        control.look(idle)


def guarded(page):
    """Whether a guardian is at work, which tells what it has done after the control process has died."""
    return time.monotonic_ns() - page.guarded < GUARDIAN_DEATH


def orphan_line(report):
    files = ", ".join(file["path"] for file in report["files"]) or "no files"
    return (
        f"tickwork recorder: the control process died; {report['ticks']} ticks were recorded, the last is {report['last_tick']}: {files}")


def answer(descriptor, message):
    """One line of JSON to the control process, if it still listens."""
    data = json.dumps(message).encode() + b"\n"
    try:
        while data:
            data = data[os.write(descriptor, data):]
    except BrokenPipeError:
        pass


def be_ordinary():
    """Neither real-time nor in a hurry, should the control process be."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        realtime.set_slice(0)
