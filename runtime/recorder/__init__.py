"""The recorder as the control process sees it: a process of its own that drains the page's ring into files, viewers and
the terminal.

    recorder = RecorderProcess(page)      # its start-up overlaps with the compiling
    recorder.configure(plan)              # files are open from here on
    ...                                   # the run
    page.close()
    report = recorder.finish()

The plan is a dict that JSON can carry:

    name, stem      of the diagram; of the files
    folder          of the recording, or None to write no files
    rate, duration  Hz; s or None
    virtual         whether time is: files of two runs are then byte-identical
    simulated       whether a plant stands behind the buses
    signals, buses  what each number of a row is (index, path, dtype, unit); the names of the buses
    diagram_json    the diagram as JSON text, or None
    control_pid     number of the control process
    sinks           of each: service (see runtime.recorder.plugins), path, parameters, columns (index, path, dtype,
                    unit)
    status_line     whether the terminal may be used; keys : whether it is asked for keys, too (by default it is)
    limits          {path: (lowest, highest)} of what is recorded, where that is known
    metadata        what else the sidecar file shall carry

SharedState(fd) -> rows, frames and events -> runtime.recorder.writer -> runtime.recorder.recording -> services
(runtime.recorder.service) and files.
"""

import json
import os
import select
import signal
import subprocess
import termios
from contextlib import suppress

from runtime.base.child_process import ChildProcess
from runtime.console.keys import own_terminal, put_back
from runtime.console.stderr import Terminal
from runtime.recording.ascii_units import ascii_name

READY_TIMEOUT = 30.0  # s, for a slow disk
ABANDON_TIMEOUT = 5.0  # s
CURE = "`convert FILE.mcap --to mcap` makes of its .mcap one that every viewer opens"


def can_ask():
    """Whether a run of this process can be answered by keys: it reads and writes a terminal of its own."""
    descriptor = own_terminal()
    if descriptor is None:
        return False
    os.close(descriptor)
    return Terminal().interactive


class RecorderError(Exception):
    """The recording cannot be made. The text says why, in one line."""


class RecorderProcess(ChildProcess):
    """The recorder process of one run. Spawned at once.

    page : cext.safety.shared_state.SharedState
    lifeline : file descriptor that hangs up when nobody is left that reads the ring
    pid : number of the process
    """

    def __init__(self, page):
        self._terminal = own_terminal()
        self._attributes = None if self._terminal is None else termios.tcgetattr(self._terminal)
        keys = () if self._terminal is None else (self._terminal,)
        super().__init__("runtime.recorder.process", (page.fd, *(keys or (-1,))), (page.fd, *keys))
        self._files = []
        self._over = self._planned = False

    def configure(self, plan):
        """Send the plan and wait until every file is open. RecorderError if one cannot be; then nothing is left
        behind.
        """
        sinks = [
            {**sink, "columns": [{**column, "ascii_unit": ascii_name(column["unit"])} for column in sink["columns"]]}
            for sink in plan["sinks"]
        ]
        self._planned = True
        order = json.dumps({**plan, "sinks": sinks}).encode() + b"\n"
        try:
            self._child.stdin.write(order)
            self._child.stdin.flush()
            answer = self._answer(READY_TIMEOUT)
        except BrokenPipeError:
            answer = None
        except TimeoutError:
            self.abandon()
            raise RecorderError(f"the recorder process was not ready within {READY_TIMEOUT:g} s") from None
        if answer is None:
            how = self._end()
            raise RecorderError(f"the recorder process ended before it was ready ({how})")
        if "error" in answer:
            self._end()
            raise RecorderError(answer["error"])
        self._files = answer["files"]

    @property
    def alive(self):
        """Whether somebody reads the ring: the process, or another that has taken over."""
        poll = select.poll()
        poll.register(self.lifeline, 0)
        return not poll.poll(0)

    @property
    def lifeline(self):
        return self._answers

    def finish(self, timeout=60.0):
        """After page.close(): wait until all is written, and return the report.

        The report has `files` (path, note), `problems` (lines of text), `strides`, `sinks`, `statistics`, `ended` and
        more: what the sidecar file holds. If the process has died, or needs longer than `timeout` s, `problems` says so
        and `files` are those it had opened.
        """
        try:
            report = self._answer(timeout)
        except TimeoutError:
            self._give_terminal_back()
            return self._lost(
                f"the recorder (process {self.pid}) had not finished after {timeout:g} s; it goes on by itself"
            )
        except OSError:
            self._end()
            return self._lost(
                "its report is missing: a block closed descriptors of the run. The recorder has "
                "finished the files by itself"
            )
        how = self._end()
        if report is None:
            return self._lost(f"the recorder process died before the end ({how}): the files stop where it did; {CURE}")
        return report

    def abandon(self):
        """The run fails before it began: the process ends and takes its files with it."""
        if self._over:
            return
        if not self._planned:  # it has created nothing, and may still be importing
            self._child.kill()
        try:
            self._child.stdin.write(b"abandon\n")
            self._child.stdin.flush()
        except OSError:
            pass  # it has ended already
        self._end(ABANDON_TIMEOUT)

    def _give_terminal_back(self):
        """As it was; the process has done that, unless it was killed."""
        if self._terminal is not None:
            with suppress(OSError):
                put_back(self._terminal, self._attributes)
                os.close(self._terminal)
            self._terminal = None

    def _lost(self, problem):
        return {"files": self._files, "problems": [problem], "strides": [], "sinks": {}, "ended": "unknown"}

    def _await_writer(self, timeout):
        """Wait until the writer has ended, too, where the process that started it was killed."""
        poll = select.poll()
        poll.register(self._answers, 0)
        poll.poll(timeout * 1e3)

    def _end(self, timeout=10.0):
        """Wait for the process to end, kill it if it does not, and say how it ended."""
        if not self._over:
            self._over = True
            try:
                self._child.stdin.close()
            except OSError:
                pass
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
            self._await_writer(timeout)
            with suppress(OSError):  # a block may have closed it
                os.close(self._answers)
            self._give_terminal_back()
        code = self._child.returncode
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"

    def __del__(self):
        if getattr(self, "_over", True) is False:
            with suppress(OSError):
                os.close(self._answers)
            self._give_terminal_back()
