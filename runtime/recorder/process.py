"""The recorder process: starts a writer (runtime.recorder.writer), and another one where a writer dies.

    start     the writer opens part 1 of the recording and drains the ring into it
    death     the cause is printed once; a new writer records part 2, 3, ... into files of its own, from the first
    record that part 1 lacks end       no new writer starts after RESTART_LIMIT deaths, after a second death of one
    cause, or once the control process has ended

Parts share nothing but the checkpoint (runtime.recorder.checkpoint), which says how far each file of the dead writer is
whole. The loop never waits for any of this: without a writer the ring fills and drops. Signals do not end this process;
the end of its writer does.
"""

import json
import os
import select
import signal
from contextlib import suppress
from pathlib import Path

from cext.clock import realtime
from cext.safety.shared_state import SharedState
from runtime.base.ending import ignore_signals
from runtime.base.exception_text import name_and_text
from runtime.base.system import maps
from runtime.console.stderr import Terminal
from runtime.recorder.checkpoint import Checkpoint
from runtime.recorder.recording import RecordingFailed
from runtime.recorder.report import PARTIAL, write_json
from runtime.recorder.writer import answer, name_process, write

ORDERS = 0  # standard input
RESTART_LIMIT = 3
CANNOT_RECORD = 2  # exit code of a writer whose files cannot be created


class Control:
    """The control process as its recorder sees it: whether it lives, and its orders on standard input.

    gone : it has ended, or runs another program
    abandoned : it wants no recording
    """

    def __init__(self, pidfd, page):
        self.pidfd, self.page = pidfd, page
        self.gone = self.abandoned = self.hung_up = False
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
                self.hung_up = True
            self.abandoned = self.abandoned or self.heard.endswith(b"abandon\n")
        if self.hung_up and not self.gone:  # at the end of a run, or where a block has closed descriptors, it goes on
            self.gone = not maps(self.page.control, self.page.fd)

    def plan(self):
        """The first order, or None if there will be none."""
        while b"\n" not in self.heard and not self.gone:
            self.look()
        line, _, self.heard = self.heard.partition(b"\n")
        return None if self.abandoned or self.gone else json.loads(line)


def main(answers, control, page, keys):
    """File descriptors of the pipe for answers, a pidfd of the control process, of the page, and its terminal's or
    -1.
    """
    ignore_signals()
    be_ordinary()
    page = SharedState(fd=page)
    orders = Control(control, page)
    plan = orders.plan()
    if plan is None:
        return
    name_process("tickwork-parts")
    checkpoint, causes, part = Checkpoint(page), [], plan.get("part", 1)
    while True:
        current = {**plan, "part": part}
        cause, unfit = death_of_writer(lambda: write(page, answers, orders, keys, current, checkpoint), page)
        state = checkpoint.newest()
        if cause is None or state is None:  # it is done, or died before it was ready, which control reports
            return
        checkpoint.cut_files(state)
        again = not unfit and cause not in causes and len(causes) < RESTART_LIMIT and not ended(control)
        causes.append(cause)
        plan, part, problem = successor(plan, part, state, cause, again, page)
        Terminal().say(f"tickwork recorder: {problem}")
        if not again:
            answer(answers, lost_report(plan["before"]))
            return


def death_of_writer(writer, page):
    """Fork a process that calls `writer`, and wait until it has ended.

    Returns the cause of its death in words, None if it finished, and whether it could not even create its files.
    """
    reader, pipe = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reader)
        code = 0
        try:
            page.rewind()
            writer()
        except BaseException as error:  # the parent prints it: a traceback would tear the status line
            code = CANNOT_RECORD if isinstance(error, RecordingFailed) else 1
            with suppress(BaseException):
                os.write(pipe, described(error).encode(errors="backslashreplace")[:500])
        os._exit(code)
    os.close(pipe)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with open(reader, "rb") as stream:
        words = stream.read().decode(errors="replace")
    if status == 0:
        return None, False
    return words or (signal.Signals(-status).name if status < 0 else f"exit code {status}"), status == CANNOT_RECORD


def described(error):
    """An exception in a line."""
    return " ".join((str(error) if isinstance(error, RecordingFailed) else name_and_text(error)).split())


def ended(pidfd):
    """Whether the process behind a pidfd has ended."""
    poll = select.poll()
    poll.register(pidfd, select.POLLIN)
    return bool(poll.poll(0))


def successor(plan, part, state, cause, again, page):
    """(plan of the next part, its number, what happened in a line). state : the newest checkpoint of the part that
    died
    """
    lost = page.statistics()["dropped"] - state["dropped"]
    died = f"the writer of part {part} died ({cause})"
    following = f"part {part + 1} continues the recording; " + (
        f"{lost} records were lost" if lost else "no record was lost"
    )
    problem = f"{died}; {following}" if again else f"{died}; recording stops and the run continues without it"
    with suppress(OSError, TypeError):
        os.unlink(state["sidecar"] + PARTIAL)  # which the writer was replacing its sidecar with
    with suppress(OSError, ValueError, TypeError):
        known = json.loads(Path(state["sidecar"]).read_text())
        write_json(
            state["sidecar"],
            {**known, "ended": f"the recorder died ({cause})" + f"; part {part + 1} continues it" * again},
        )
    before = plan.get("before", {"files": {}, "logs": [], "problems": [], "stem": state["stem"]})
    before = {
        "files": before["files"] | {path: remark or f"part {part}" for path, remark in state["files"].items()},
        "logs": [*before["logs"], *filter(None, [state["log"]])],
        "problems": [*before["problems"], problem],
        "stem": before["stem"],
        "lost": lost,
    }
    return {**plan, "before": before, "stem": f"{before['stem']}_part{part + 1}"}, part + 1, problem


def lost_report(before):
    """What control gets where recording has stopped for good."""
    files = [{"path": path, "note": remark} for path, remark in before["files"].items()]
    return {"files": files, "problems": before["problems"], "strides": [], "sinks": {}, "ended": "unknown"}


def be_ordinary():
    """Drop real-time priority and a short time slice, which the control process may have."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        realtime.set_slice(0)
