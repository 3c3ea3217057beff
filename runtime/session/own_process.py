"""A run in real time or on a rig for a script or a notebook: the command `run` in a process of its own.

The process has a pseudo terminal, so that it is the command in every respect: guardian, recorder, pre-flight table and
safe stop. Its lines are printed here, and Ctrl-C is passed on. The terminal also closes when this process is killed;
the run then ends with a safe stop.
"""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cext.safety.thresholds import STOP_UNATTENDED
from cext.schedule.mailbox_writer import Writer
from runtime.host.console.cell import in_cell
from runtime.host.console.confirm import discard_typed
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, BadInput
from runtime.host.interrupts import show_as_line
from runtime.host.live.requests import as_text
from runtime.host.live.running import shared_state_of
from runtime.host.options import pairs_of
from runtime.host.suggestions import unknown_option
from runtime.record.analysis.trial import Trial
from runtime.record.report.preflight.text import ASK, ASK_AGAIN
from runtime.session.request import Request

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState

ROOT = str(Path(__file__).parents[2])
ROWS, COLUMNS = 24, 120  # of the pseudo terminal
POLL_PERIOD = 0.05  # s
END_TIMEOUT = 2.0  # s for a run to end on request; its stop alone may take as long as its damping
ANSWER_TIMEOUT = 1.0  # s for the run to take a confirmation
STATUS_PERIOD = 1.0  # s, of the status line
SIGNAL_PERIOD = 1.0  # s, after which SIGINT is repeated: while it starts, a process may ignore it
KILLING_INTERRUPT = 3  # a run that has not ended at this number of Ctrl-C is killed; its guardian stops the motors
PROMPT = "Enter arms the robot, q ends the run: "
NOT_OPTIONS = ("file", "fast", "settings", "no_record", "report")

# The pseudo terminal becomes the controlling one. This program's packages are imported before any others of their name.
# SIGINT is blocked until it no longer raises an exception, which could be anywhere in the start of the interpreter.
BOOT = """
import fcntl, signal, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
sys.path[:1] = [sys.argv.pop(1)]
from runtime.host import ending
ending.leave_on_signals()
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
import cext, graph, blocks, runtime.__main__
sys.path.append(sys.path.pop(0))
runtime.__main__.main(None)
"""


def process_of(file: Any, settings: Any, plant: Any = None, **options: Any) -> RunProcess:
    """Start a run in a process of its own. Arguments, errors: see runtime.run. options : {field of Request: value}"""
    if plant is not None:
        raise BadInput("plant: a run in real time has the plant of its diagram file: define plant(robot) there")
    if not isinstance(file, (str, os.PathLike)):
        raise BadInput(
            "a run in real time or on a rig has a process of its own, which loads a diagram file: save the diagram as "
            'a file (in a notebook with %%writefile) and pass its path, as in runtime.run("knee.py", 10, fast=False)'
        )
    if options.get("record") is None:
        options["record"] = "recordings"
    if options.get("rig") is not None and options.get("stop_for") is None:
        options["stop_for"] = float(STOP_UNATTENDED)  # s: a program may run without an operator
    arguments = [os.fspath(file), *words(pairs_of(settings), options)]
    return RunProcess(arguments, asks=options.get("rig") is not None and not options.get("yes"))


def check_names(options: Iterable[str]) -> None:
    """Raise BadInput for an unknown option. options : names of fields of Request"""
    known = [field.name for field in fields(Request) if field.metadata and field.name not in NOT_OPTIONS]
    for name in options:
        if name not in known:
            raise BadInput(unknown_option(name, known))


def words(settings: Iterable[tuple[str, Any]], options: Mapping[str, Any]) -> list[str]:
    """Return the arguments of the command. options : {field of Request: value}. Raises BadInput for an unknown one."""
    check_names(options)
    known = {field.name: field.metadata for field in fields(Request)}
    arguments = []
    for name, value in options.items():
        (flag, *_), argument = known[name]["flags"], known[name]["argument"]
        if value is None or value is False:
            continue
        if value is True:
            arguments.append(flag)
        elif isinstance(value, Mapping):
            pairs = [f"{key}={as_text(each)}" for key, each in value.items()]
            arguments += [flag, *pairs] if argument.get("nargs") else [f"{flag}={pair}" for pair in pairs]
        elif isinstance(value, (list, tuple)) and argument.get("action") == "append":
            arguments += [f"{flag}={as_text(each)}" for each in value]
        else:
            arguments.append(f"{flag}={as_text(value)}")
    return [*arguments, *(f"--set={name}={as_text(value)}" for name, value in settings)]


class RunProcess:
    """The command `run` on a pseudo terminal.

    arguments : arguments of the command
    asks : whether a rig is armed only after a confirmation, which is asked for with input()
    """

    def __init__(self, arguments: list[str], asks: bool) -> None:
        self.asks, self.asked, self.interrupts = asks, False, 0
        self.shared: SharedState | None = None
        self.lines: list[str] | None = []  # that were not printed yet: an error, if nothing follows; None: print
        self.unfinished, self.report = "", b""
        self.status, self.status_due = "", 0.0
        self.decode = getincrementaldecoder("utf-8")("replace").decode
        self.descriptors: list[int] = []
        try:
            self._start(arguments)
        except BaseException:
            self._release()
            raise

    def _start(self, arguments: list[str]) -> None:
        self.terminal, theirs = pty.openpty()
        self.answers, reports = os.pipe()
        self.descriptors += [self.terminal, self.answers]
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        environment = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}  # of the notebook
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            self.child = subprocess.Popen(
                [sys.executable, "-c", BOOT, ROOT, "run", f"--report={reports}", *arguments],
                stdin=theirs,
                stdout=theirs,
                stderr=theirs,
                pass_fds=(reports,),
                start_new_session=True,
                env={**environment, "TERM": "xterm", "NO_COLOR": "1"},
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(theirs)
            os.close(reports)
        self.ended = os.pidfd_open(self.child.pid)
        self.descriptors.append(self.ended)
        self.poll = select.poll()
        for descriptor in self.descriptors:
            self.poll.register(descriptor, select.POLLIN)

    def wait(self) -> Trial:
        """Print the output of the run until it has ended, and return its Trial. Raises as runtime.run does."""
        self._follow(lambda over: over)
        return self.trial()

    def start(self) -> bool:
        """Wait until the robot is armed. Returns False if the run has ended. Raises as runtime.run does."""
        self._follow(lambda over: over or self._state() == "running")
        return self.child.returncode is None

    def end(self) -> None:
        """Stop the run, if it still runs, and wait until its recording is complete."""
        if self.child.returncode is not None:
            return
        try:
            if self.shared is not None:
                Writer(self.shared).stop()
            until = time.monotonic() + END_TIMEOUT
            while not self.look(POLL_PERIOD):
                if self.shared is None or time.monotonic() > until:
                    self._stop()
                    return
        except BaseException:
            self._stop()
            raise
        finally:
            self._release()

    def trial(self) -> Trial:
        """Return the Trial of a run that has ended. Raises as runtime.run does."""
        recording = self._recording()
        if self.child.returncode in (BAD_INPUT, CHECK_FAILED):
            text = "\n".join(line.removeprefix("tickwork: ") for line in self.lines or ())
            raise BadInput(text or "the run did not start: the lines above state the reason")
        self._show()
        if recording is None:
            how = f"signal {-self.child.returncode}" if self.child.returncode < 0 else f"code {self.child.returncode}"
            raise RuntimeError(f"the process of the run ended with {how} and without a report; see its recording")
        return Trial(recording)

    def explain(self, error: object) -> None:
        """State in a KeyboardInterrupt that has ended the run where its recording is."""
        if isinstance(error, KeyboardInterrupt) and (recording := self._recording()):
            show_as_line(error, f"the run was stopped; its recording is {recording}")

    def _follow(self, done: Callable[[bool], bool]) -> None:
        """Follow the run until `done`, a function of whether it has ended. An exception ends the run."""
        try:
            while not done(over := self.look(POLL_PERIOD)):
                if self.asks and self._state() == "ready":
                    self._show()
                    if self.asked:  # the recorder has printed the pre-flight table
                        self._confirm()
        except BaseException as error:
            self._stop()
            self._release()
            self.explain(error)
            raise
        if over:
            self._release()

    def look(self, seconds: float) -> bool:
        """Read the output of the process within a time in s. Returns whether it has ended."""
        until = time.monotonic() + seconds
        while True:
            left = max(0.0, until - time.monotonic())
            ready = {descriptor for descriptor, _ in self.poll.poll(left * 1e3)}
            if self.answers in ready:
                self._take_report()
            if self.terminal in ready and self._take_text():
                pass  # the rest of its text comes before its end
            elif self.ended in ready:
                self.child.wait()
                return True
            if time.monotonic() >= until:
                return False

    def _take_report(self) -> None:
        data = os.read(self.answers, 1 << 16)
        self.report += data
        if not data:
            self.poll.unregister(self.answers)

    def _take_text(self) -> bool:
        """Read from the terminal. Returns whether there was any text."""
        try:
            data = os.read(self.terminal, 1 << 16)
        except OSError:  # no process has it open
            data = b""
        if not data:
            self.poll.unregister(self.terminal)
            return False
        *whole, self.unfinished = (self.unfinished + self.decode(data)).split("\n")
        for line in whole:
            self._take_line(bare(line))
        if "\r" in self.unfinished:  # a status line: the run has begun
            self.unfinished = self.unfinished[self.unfinished.rstrip("\r").rindex("\r") :]
            self._show()
            self._take_status(bare(self.unfinished))
        return True

    def _take_line(self, line: str) -> None:
        self.asked |= line in (ASK, ASK_AGAIN)
        if self.lines is not None:
            self.lines.append(line)
        else:
            write(f"\r{line:{len(self.status)}}\n" if self.status else f"{line}\n")
            self.status = ""

    def _take_status(self, text: str) -> None:
        """Show the status line once a second, where it replaces the one before."""
        if text and replaces_lines() and time.monotonic() >= self.status_due:
            write(f"\r{text:{len(self.status)}}")
            self.status, self.status_due = text, time.monotonic() + STATUS_PERIOD

    def _show(self) -> None:
        """Print the lines that were kept in case of an error, and from now on each at once."""
        lines, self.lines = self.lines or (), None
        for line in lines:
            self._take_line(line)

    def _state(self) -> str:
        """Return the state of the run; "init" before it has one."""
        if self.shared is None:
            with suppress(PermissionError):
                self.shared = shared_state_of(self.child.pid)
        return "init" if self.shared is None else self.shared.state

    def _confirm(self) -> None:
        """Ask whether the robot may be armed, and pass the answer on. Raises BadInput where input() cannot ask."""
        assert self.shared is not None
        question, self.asked = self.shared.question, False
        discard_typed()
        try:
            ends = input(PROMPT).strip().lower().startswith("q")
        except Exception as error:  # EOFError of a script, an error of the kernel's own without a frontend, ...
            raise BadInput(
                f"cannot ask for the confirmation of the pre-flight table here ({error}): the run was ended and "
                "nothing was armed. Run where input() works, or pass yes=True to arm without confirmation"
            ) from None
        if ends:
            Writer(self.shared, "keys").stop()
        else:
            Writer(self.shared).confirm(question)
        until = time.monotonic() + ANSWER_TIMEOUT
        while self._state() == "ready" and time.monotonic() < until and not self.look(POLL_PERIOD):
            pass

    def _stop(self) -> None:
        """Stop the run as Ctrl-C does, and wait until its motors are off and its recording is complete."""
        self.asks, over = False, False
        while not over:
            self.interrupts += 1
            number = signal.SIGKILL if self.interrupts >= KILLING_INTERRUPT else signal.SIGINT
            with suppress(KeyboardInterrupt):
                while not over:
                    with suppress(ProcessLookupError):
                        signal.pidfd_send_signal(self.ended, number)
                    over = self.look(SIGNAL_PERIOD)
        self._show()

    def _recording(self) -> str | None:
        """Return the path of the recording; None without a report."""
        files = json.loads(self.report)["files"] if self.report.endswith(b"\n") else []
        return next((file["path"] for file in files if file["path"].endswith(".mcap")), None)

    def _release(self) -> None:
        """Close the terminal, which ends a run that still continues with a safe stop."""
        while self.descriptors:
            os.close(self.descriptors.pop())

    def __del__(self) -> None:
        if "descriptors" in vars(self):  # else Ctrl-C came before
            self._release()


def bare(text: str) -> str:
    """Return what a terminal shows of a line: its text after the last return that text follows."""
    return re.sub(r"\x1b\[(J|\?7[lh])", "", text.rstrip("\r").rpartition("\r")[2])


def write(text: str) -> None:
    """Write to standard output. A closed one does not end the run."""
    with suppress(OSError, ValueError, AttributeError):  # closed, or None in a program without one
        sys.stdout.write(text)
        sys.stdout.flush()


def replaces_lines() -> bool:
    """Return whether standard output is a terminal or a cell, where a return begins the line again."""
    with suppress(ValueError, AttributeError):
        return sys.stdout.isatty() or in_cell()
    return False
