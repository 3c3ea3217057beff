"""The recorder: a process that drains the ring of a run into files, viewers and the terminal.

    recorder = RecorderProcess()          # starts while the diagram is loaded and compiled
    shared = SharedState(capacity, empty=recorder.memory)
    recorder.configure(plan)              # returns once all files are open
    ...                                   # the run
    shared.close()
    report = recorder.finish()

runtime.record.recorder.plan_types has the keys of the plan.

SharedState(fd) -> rows, frames and events -> runtime.record.recorder.writer -> runtime.record.recorder.part -> services
(runtime.record.recorder.service) and files.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from runtime.host.child_process import ChildProcess, import_path
from runtime.host.console.keys import own_terminal
from runtime.host.console.stderr import Terminal
from runtime.host.descriptors import identity
from runtime.record.storage.ascii_units import ascii_name

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.record.recorder.plan_types import Plan

READY_TIMEOUT = 30.0  # s, for a slow disk
ABANDON_TIMEOUT = 0.03  # s for the recorder to remove its files and end; it does so alone after that
REMEDY = "complete its .mcap file with `convert FILE.mcap --to mcap`"


def await_files(report: dict[str, Any], timeout: float = 60.0) -> None:
    """Wait until the files of a report are complete: a process may still draw a picture. timeout : s"""
    with suppress(OSError):  # it has ended
        descriptor = os.pidfd_open(report.get("completing") or -1)
        try:
            poll = select.poll()
            poll.register(descriptor, select.POLLIN)
            poll.poll(timeout * 1e3)
        finally:
            os.close(descriptor)


def can_ask() -> bool:
    """Return whether this process reads and writes a terminal, so that the operator can press keys."""
    descriptor = own_terminal()
    if descriptor is None:
        return False
    os.close(descriptor)
    return Terminal().interactive


def working_folder() -> str | None:
    """Return the working folder, None if it was deleted."""
    with suppress(OSError):
        return os.getcwd()
    return None


class RecorderError(Exception):
    """The recording cannot be made. The text is the reason in one line."""


class RecorderProcess(ChildProcess):
    """The recorder process of one run. Spawned at once.

    shared : cext.memory.shared_state.SharedState, None if it is made later
    companion : file descriptor of its connection to a companion (see runtime.record.recorder.companion); -1 without one
    memory : file descriptor of the shared state, an empty memory file until it is made
    lifeline : file descriptor that hangs up once no process reads the ring
    terminal : file descriptor of the terminal of this process, None without one
    pid : process id
    files : [{path, note}] of the files that it has opened
    """

    def __init__(self, shared: SharedState | None = None, companion: int = -1) -> None:
        if shared is None:
            from cext.ring.sealed_memory import empty_memory

        self.memory = empty_memory("tickwork") if shared is None else shared.fd
        self._memory_file, self._owner = identity(self.memory), os.getpid()
        self.terminal = own_terminal()
        keys = -1 if self.terminal is None else self.terminal
        numbers = (os.getpid(), self.memory, keys, companion)
        inherited = tuple(descriptor for descriptor in numbers[1:] if descriptor >= 0)
        super().__init__("runtime.record.recorder.process", numbers, inherited)
        self.files: list[dict[str, str]] = []
        self._over = self._planned = False

    def configure(self, plan: Plan) -> None:
        """Send the plan and wait until every file is open.

        Raises RecorderError if a file cannot be opened; the files opened before are then removed.
        """
        sinks = [
            {**sink, "columns": [{**column, "ascii_unit": ascii_name(column["unit"])} for column in sink["columns"]]}
            for sink in plan["sinks"]
        ]
        self._planned = True
        with suppress(OSError):
            os.killpg(self.pid, signal.SIGCONT)  # the diagram file may have stopped its child processes
        surroundings = {"folder": working_folder(), "path": import_path(), "environment": dict(os.environ)}
        order = json.dumps({**plan, "sinks": sinks, "surroundings": surroundings}).encode() + b"\n"
        try:
            self._send(order, READY_TIMEOUT)
            answer = self._answer(READY_TIMEOUT)
        except BrokenPipeError:
            answer = None
        except TimeoutError:
            self.abandon()
            raise RecorderError(
                f"the recorder process was not ready within {READY_TIMEOUT:g} s: a debugger or the diagram has stopped "
                "it, or the disk is slow. Remove what stops child processes, or record to another disk with --record"
            ) from None
        if answer is None:
            how = self._end()
            raise RecorderError(f"the recorder process ended before it was ready ({how})")
        if "error" in answer:
            self._end()
            raise RecorderError(answer["error"])
        self.files = answer["files"]

    @property
    def usable(self) -> bool:
        """Whether it waits for its plan. Code of this process may have ended it, closed its descriptors, or forked."""
        return self._is_own and self.connected and self.alive and identity(self.memory) == self._memory_file

    def dismiss(self) -> None:
        """End the process if it has received no plan, unless this is a fork of its owner."""
        if not self._planned and self._is_own:
            self.abandon()

    @property
    def _is_own(self) -> bool:
        """Whether this process started it: a fork of that process did not."""
        return os.getpid() == self._owner

    @property
    def alive(self) -> bool:
        """Whether a process reads the ring: the recorder or a process that has replaced it."""
        poll = select.poll()
        poll.register(self.lifeline, 0)
        try:
            return not poll.poll(0)
        except OSError:  # a block has lowered the limit of file descriptors
            return False

    @property
    def lifeline(self) -> int:
        """File descriptor that hangs up once no process reads the ring."""
        return self._answers

    def make_room(self, seconds: float) -> bool:
        """Wait, so that the process can empty the ring. Returns whether a process reads it."""
        time.sleep(seconds)
        return self.alive

    def finish(self, timeout: float = 60.0) -> dict[str, Any]:
        """After shared.close(): wait until all is written, and return the report.

        The report has `files` (path, note), `problems` (lines of text), `strides`, `sinks`, `statistics`, `ended` and
        more: the content of the sidecar file; `completing` is the ID of a process that still completes files, or None.
        If the process has died or exceeds `timeout` s, `problems` states it
        and `files` lists the files that it had opened.
        """
        try:
            report = self._answer(timeout)
        except TimeoutError:
            self._close_terminal()
            return self._report_of_loss(
                f"the recorder (process {self.pid}) has not finished after {timeout:g} s and continues alone"
            )
        except OSError:
            self._end()
            return self._report_of_loss(
                "the report of the recorder is missing, because a block closed file descriptors of the run or "
                "lowered their limit. The recorder has completed the files"
            )
        how = self._end()
        if report is None:
            return self._report_of_loss(
                f"the recorder process died before the end ({how}) and the files end there; {REMEDY}"
            )
        return report

    def abandon(self) -> None:
        """End the process and remove its files: the run has failed before its start."""
        if self._over:
            return
        if not self._planned:  # no file was created yet
            self._child.kill()
        with suppress(OSError):  # it has ended already, or does not read
            self._send(b"abandon\n", 0.0)
        with suppress(OSError):
            os.killpg(self.pid, signal.SIGTERM)  # while it opens files it reads no order
        self._end(ABANDON_TIMEOUT)

    def _close_terminal(self):
        if self.terminal is not None:
            with suppress(OSError):  # a block may have closed it
                os.close(self.terminal)
            self.terminal = None

    def _report_of_loss(self, problem):
        return {"files": self.files, "problems": [problem], "strides": [], "sinks": {}, "ended": "unknown"}

    def _await_writer(self, timeout):
        """Wait until the writer has ended, if the process that started it was killed."""
        if not self._may_answer:  # another file may never hang up
            return
        poll = select.poll()
        poll.register(self._answers, 0)
        with suppress(OSError):  # a block has lowered the limit of file descriptors
            poll.poll(timeout * 1e3)

    def _end(self, timeout=10.0):
        """Wait for the process to end and kill it after `timeout` s. Returns how it ended."""
        if not self._over:
            self._over = True
            with suppress(OSError):
                self._orders.close()
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
            self._await_writer(timeout)
            self._close_answers()
            self._close_terminal()
        code = self._child.returncode
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"

    def __del__(self):
        if getattr(self, "_over", True) is False:
            self._close_answers()
            self._close_terminal()
