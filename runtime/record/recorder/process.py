"""The recorder process: starts a writer (runtime.record.recorder.writer), and a new one when a writer dies.

* start: the writer opens part 1 of the recording and drains the ring into it
* death: the cause is printed once, and a new writer records part 2, 3, ... from the first record that is missing
* end: no new writer starts after RESTART_LIMIT deaths, after a second death of the same cause, or once the control
  process has ended

Parts share only the checkpoint (runtime.record.recorder.checkpoint), which holds the complete length of each file. The
loop never waits for a writer: without one the ring fills and drops records. This process ignores signals and ends after
its writer.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cext.clock import realtime
from cext.memory.shared_state import SharedState
from cext.user_text import name_and_text
from runtime.host.console.keys import restore, terminal_attributes
from runtime.host.console.stderr import Terminal
from runtime.host.ending import ignore_signals
from runtime.host.run_mark import end_marked, own_mark, remove_mark
from runtime.host.system import maps, name_process
from runtime.record.recorder.checkpoint import Checkpoint
from runtime.record.recorder.part import RecordingFailed
from runtime.record.recorder.report import PARTIAL, write_json
from runtime.record.recorder.writer import answer, write
from runtime.record.storage.files import STOPPED_EARLY

if TYPE_CHECKING:
    from runtime.record.recorder.plan_types import Plan, PlanBefore, Surroundings

ORDERS_DESCRIPTOR = 0  # standard input
RESTART_LIMIT = 3
CANNOT_RECORD = 2  # exit code of a writer whose files cannot be created


class Control:
    """State of the control process and its orders on standard input.

    mark : mark of the processes that its user code has started, which end with it; None without one
    gone : whether it has ended or runs another program
    abandoned : whether it has ordered to discard the recording
    """

    def __init__(self, pidfd, pid, shared, mark):
        self.pidfd, self.pid, self.shared, self.mark = pidfd, pid, shared, mark
        self.gone = self.abandoned = self.hung_up = False
        self.received = b""
        self.poll = select.poll()
        self.poll.register(pidfd, select.POLLIN)
        self.poll.register(ORDERS_DESCRIPTOR, select.POLLIN)

    def look(self, milliseconds: float | None = None) -> None:
        """Wait for an order or the end of the control process, at most for `milliseconds`."""
        for descriptor, _ in self.poll.poll(milliseconds):
            if descriptor == self.pidfd:
                self.gone = True
                self.poll.unregister(self.pidfd)
                end_marked(self.mark)
                continue
            data = os.read(ORDERS_DESCRIPTOR, 1 << 20)
            self.received += data
            if not data:
                self.poll.unregister(ORDERS_DESCRIPTOR)
                self.hung_up = True
            self.abandoned = self.abandoned or self.received.endswith(b"abandon\n")
        if self.hung_up and not self.gone:  # a hang-up alone: end of the run, or a block has closed descriptors
            self.gone = not maps(self.pid, self.shared)

    def plan(self) -> Plan | None:
        """Return the plan, which is the first order; None if the run ends before it."""
        while b"\n" not in self.received and not self.gone:
            self.look()
        line, _, self.received = self.received.partition(b"\n")
        return None if self.abandoned or self.gone else json.loads(line)


def main(answers: int, control: int, pid: int, shared: int, keys: int, companion: int) -> None:
    """Run the recorder process.

    answers : file descriptor of the pipe to the control process
    control, pid : pidfd and ID of the control process
    shared : file descriptor of the shared state, which exists once the plan arrives
    keys : file descriptor of the terminal, or -1
    companion : file descriptor of the connection to a companion, or -1
    """
    ignore_signals()
    be_ordinary()
    mark = own_mark(pid)
    remove_mark()
    orders = Control(control, pid, shared, mark)
    plan = orders.plan()
    if plan is None:
        return
    follow(plan.pop("surroundings"))
    state = SharedState(fd=shared)
    name_process("tickwork-parts")
    record_parts(state, answers, orders, keys, companion, plan)
    if has_ended(control):  # after the writer has seen it alive
        end_marked(mark)


def follow(surroundings: Surroundings) -> None:
    """Take over the folder, path and environment of the control process, which its user code may have changed."""
    if surroundings["folder"] is not None:
        os.chdir(surroundings["folder"])
    sys.path[:] = surroundings["path"]
    os.environ.update(surroundings["environment"])
    for name in set(os.environ).difference(surroundings["environment"]):
        del os.environ[name]
    time.tzset()


def record_parts(shared: SharedState, answers: int, orders: Control, keys: int, companion: int, plan: Plan) -> None:
    """Record the parts of a recording, and answer if it stops before the end of the run."""
    checkpoint, causes, part = Checkpoint(shared), [], plan.get("part", 1)
    attributes = terminal_attributes(keys) if keys >= 0 else None
    while True:
        current: Plan = {**plan, "part": part}
        cause, unfit = death_of_writer(lambda: write(shared, answers, orders, companion, current, checkpoint), shared)
        # the control process was killed and has not restored the terminal; its pidfd may not show it yet
        if attributes is not None and not maps(shared.control, shared.fd):
            restore(keys, attributes)
        state = checkpoint.newest()
        if cause is None or state is None:  # complete, or dead before it was ready, which the control process reports
            return
        checkpoint.cut_files(state)
        again = not unfit and cause not in causes and len(causes) < RESTART_LIMIT and not has_ended(orders.pidfd)
        causes.append(cause)
        plan, part, problem = successor(plan, part, state, cause, again, shared)
        Terminal().say(f"tickwork recorder: {problem}")
        if not again:
            assert "before" in plan
            answer(answers, lost_report(plan["before"]))
            return


def death_of_writer(writer: Callable[[], None], shared: SharedState) -> tuple[str | None, bool]:
    """Fork a process that calls `writer`, and wait until it has ended.

    Returns the cause of its death as text, None if it completed, and whether it could not create its files.
    """
    reader, pipe = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reader)
        code = 0
        try:
            shared.rewind()
            writer()
        except BaseException as error:  # the parent prints it: a traceback would tear the status line
            code = CANNOT_RECORD if isinstance(error, RecordingFailed) else 1
            with suppress(BaseException):
                os.write(pipe, error_text(error).encode(errors="backslashreplace")[:500])
        os._exit(code)
    os.close(pipe)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with open(reader, "rb") as stream:
        text = stream.read().decode(errors="replace")
    if status == 0:
        return None, False
    return text or (signal.Signals(-status).name if status < 0 else f"exit code {status}"), status == CANNOT_RECORD


def error_text(error: BaseException) -> str:
    """Return the text of an exception in one line."""
    return " ".join((str(error) if isinstance(error, RecordingFailed) else name_and_text(error)).split())


def has_ended(pidfd: int) -> bool:
    """Return whether the process of a pidfd has ended."""
    poll = select.poll()
    poll.register(pidfd, select.POLLIN)
    return bool(poll.poll(0))


def successor(
    plan: Plan, part: int, state: dict[str, Any], cause: str, again: bool, shared: SharedState
) -> tuple[Plan, int, str]:
    """Return (plan of the next part, its number, the problem in one line).

    state : newest checkpoint of the part whose writer died
    again : whether a next part follows
    """
    lost = shared.statistics()["dropped"] - state["dropped"]
    died = f"the writer of part {part} died ({cause})"
    following = f"part {part + 1} continues the recording; " + (
        f"{lost} records were lost" if lost else "no record was lost"
    )
    problem = f"{died}; {following}" if again else f"{died}; recording stops and the run continues without it"
    with suppress(OSError, TypeError):
        os.unlink(state["sidecar"] + PARTIAL)  # incomplete replacement of the sidecar
    with suppress(OSError, ValueError, TypeError):
        sidecar = json.loads(Path(state["sidecar"]).read_text())
        write_json(
            state["sidecar"],
            {**sidecar, "ended": f"the recorder died ({cause})" + f"; part {part + 1} continues it" * again},
        )
    before: PlanBefore = plan.get(
        "before", {"files": {}, "logs": [], "problems": [], "stem": state["stem"], "lost": 0, "kept": {}}
    )
    before = {
        "files": before["files"] | {path: remark or f"part {part}" for path, remark in state["files"].items()},
        "logs": [*before["logs"], *filter(None, [state["log"]])],
        "problems": [*before["problems"], problem],
        "stem": before["stem"],
        "lost": lost,
        "kept": state.get("kept", {}),
    }
    return {**plan, "before": before, "stem": f"{before['stem']}_part{part + 1}"}, part + 1, problem


def lost_report(before: PlanBefore) -> dict[str, Any]:
    """Return the report of a recording that has stopped before the end of the run."""
    files = [{"path": path, "note": remark} for path, remark in before["files"].items()]
    return {"files": files, "problems": before["problems"], "strides": [], "sinks": {}, "ended": STOPPED_EARLY}


def be_ordinary() -> None:
    """Drop real-time priority and a short time slice, which the control process may have."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        realtime.set_slice(0)
