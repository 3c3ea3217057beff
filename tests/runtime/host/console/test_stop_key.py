"""The space bar stops a run whatever its other processes, its mailbox and its terminal do, and an earlier key confirms
nothing: real terminals, real processes, real signals.
"""

import os
import signal
import time
from contextlib import suppress

import psutil
import pytest

from cext.schedule.mailbox_writer import Writer
from runtime.host.live.running import shared_state_of
from tests.runtime.runs import Files, descendant, write, writer_of
from tests.runtime.terminals import Terminal, live_diagram, patient

pytestmark = pytest.mark.paced

UP, TAB = b"\x1b[A", b"\t"
STOP_LIMIT = 1.0  # s from the key to the end of the loop, on a machine that is busy
CTRL_C, CTRL_S = b"\x03", b"\x13"
NOT_TAKEN = "the recorder does not take the keys. The space bar still stops the run, and so does Ctrl-C"

# raises once, from the outside
FRAGILE = """
import os
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Output

class Law(Block):
    y = Output("1")

    def step(self):
        if os.path.exists("break"):
            os.unlink("break")
            raise ValueError("a wire has come loose")
        return 1.0

with Diagram("fragile", rate=200) as diagram:
    Law(name="law")
    CsvRecorder()
"""


@pytest.fixture
def terminal():
    with Terminal() as found:
        found.suspended = []
        yield found
    for pid in found.suspended:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def suspend_recorder(terminal):
    """Stop the processes of its recorder, the one that starts writers and the writer, without ending them."""
    pid = terminal.process.pid
    terminal.suspended = [descendant(pid, "tickwork-parts"), writer_of(pid)]
    for each in terminal.suspended:
        os.kill(each, signal.SIGSTOP)


def resume_recorder(terminal):
    while terminal.suspended:
        os.kill(terminal.suspended.pop(), signal.SIGCONT)


class Run:
    """A run in the foreground of a terminal."""

    def __init__(self, terminal, folder, *words):
        live_diagram(folder)
        terminal.run("springs.py", "--no-record", *words, cwd=folder)
        terminal.wait_for("lists the keys")
        self.terminal, self.pid = terminal, terminal.process.pid
        self.shared = shared_state_of(self.pid)
        patient(lambda: self.shared.state == "running")  # the line is there before

    def assert_stops(self):
        """The loop ends in time, and the process once its recorder goes on."""
        until = time.monotonic() + STOP_LIMIT
        while self.shared.state == "running" and time.monotonic() < until:
            time.sleep(0.005)
        assert self.shared.state in ("stopping", "safe")
        resume_recorder(self.terminal)
        assert self.terminal.end() == 0 and self.terminal.attributes == self.terminal.before


@pytest.mark.hazard("H9b")
def test_the_space_bar_stops_a_run_whose_recorder_is_stopped(tmp_path, terminal):
    run = Run(terminal, tmp_path)
    suspend_recorder(terminal)
    terminal.press(TAB + 40 * UP)
    terminal.wait_for(NOT_TAKEN)
    terminal.press(b" ")
    run.assert_stops()
    assert "stopped by the space bar" in terminal.look()


@pytest.mark.hazard("H9b")
def test_the_space_bar_stops_a_run_whose_recorder_was_killed_until_it_stays_dead(tmp_path, terminal):
    run = Run(terminal, tmp_path)
    for _ in range(2):  # no part follows a second death of the same cause
        writer = writer_of(run.pid)
        os.kill(writer, signal.SIGKILL)
        patient(lambda: not psutil.pid_exists(writer))
        patient(lambda: writer_of(run.pid) not in (None, writer) or "recording stops" in terminal.look())
    terminal.wait_for("recording stops and the run continues without it")
    assert run.shared.state == "running" and terminal.takes_keys
    terminal.press(b"m")
    terminal.wait_for(NOT_TAKEN)
    terminal.press(b" ")
    run.assert_stops()


@pytest.mark.hazard("H9b")
def test_the_space_bar_stops_a_run_whose_mailbox_is_full(tmp_path, terminal):
    run = Run(terminal, tmp_path)
    writer = Writer(run.shared)
    while writer.set([(1, 5.0)]) is not None:
        pass  # its answers are not read
    terminal.press(TAB + 20 * UP)
    terminal.wait_for(r"spring.stiffness was not changed: the mailbox of the run is full")
    terminal.press(20 * UP + b" ")
    run.assert_stops()


@pytest.mark.parametrize("held", ["no one reads it", "Ctrl-S"])
@pytest.mark.hazard("H9b")
def test_the_space_bar_stops_a_run_whose_terminal_takes_no_output(tmp_path, terminal, held):
    run = Run(terminal, tmp_path)
    if held == "Ctrl-S":
        os.write(terminal.master, CTRL_S)
    for _ in range(40):  # a key that repeats for 1.2 s over a slow connection
        os.write(terminal.master, UP)
        time.sleep(0.03)
    os.write(terminal.master, b" ")
    until = time.monotonic() + STOP_LIMIT
    while run.shared.state == "running" and time.monotonic() < until:
        time.sleep(0.005)
    assert run.shared.state in ("stopping", "safe")


def test_ctrl_c_stops_a_run_whose_keys_no_other_process_takes(tmp_path, terminal):
    """More of them than the queue of a terminal holds, behind which Ctrl-C would not be seen."""
    run = Run(terminal, tmp_path)
    suspend_recorder(terminal)
    for _ in range(60):
        os.write(terminal.master, 40 * UP)
        time.sleep(0.005)
    os.write(terminal.master, CTRL_C)
    patient(lambda: run.shared.state in ("stopping", "safe"), 2.0)
    resume_recorder(terminal)
    assert terminal.end() == 130


def test_a_space_before_many_other_keys_and_between_them_stops_the_run(tmp_path, terminal):
    run = Run(terminal, tmp_path)
    suspend_recorder(terminal)
    terminal.press(30 * UP + b" " + 30 * UP)
    run.assert_stops()


def test_a_space_while_the_run_starts_ends_it(tmp_path, terminal):
    live_diagram(tmp_path)
    terminal.run("springs.py", cwd=tmp_path)
    time.sleep(0.1)
    os.write(terminal.master, b" ")
    assert terminal.end() == 0 and "stopped by the space bar" in terminal.look()
    [stop] = [event for event in Files(tmp_path / "recordings").sidecar["events"] if event["event"] == "stop"]
    assert (
        stop["tick"] < 20 and stop["by"] == "keys"
    )  # before its first tick, unless the machine was too busy to read it


def test_the_space_bar_stops_a_run_whose_block_has_closed_all_descriptors(tmp_path, terminal):
    law = "import os\n        if tick >= 20: os.closerange(3, 256)\n        return self.angle"
    write(
        tmp_path,
        live_diagram(tmp_path)
        .read_text()
        .replace("def step(self):", "def step(self, tick):")
        .replace("return self.angle", law),
        "springs.py",
    )
    terminal.run("springs.py", "--no-record", cwd=tmp_path)
    shared = patient(lambda: shared_state_of(terminal.process.pid))
    patient(lambda: shared.statistics()["ticks"] > 100)
    assert shared.state == "running" and terminal.takes_keys
    terminal.press(b" ")
    assert terminal.end() == 0 and "stopped by the space bar" in terminal.look()
    assert terminal.attributes == terminal.before


@pytest.mark.hazard("H4a")
@pytest.mark.parametrize("late", [False, True])
def test_a_key_from_before_a_fault_arms_nothing_however_late_it_is_delivered(tmp_path, terminal, late):
    write(tmp_path, FRAGILE, "fragile.py")
    terminal.run("fragile.py", "--rearm", "--no-record", cwd=tmp_path)
    terminal.wait_for("lists the keys")
    shared = shared_state_of(terminal.process.pid)
    if late:
        suspend_recorder(terminal)
    terminal.press(b"r")
    time.sleep(0.3)
    (tmp_path / "break").touch()
    patient(lambda: shared.state == "waiting")
    resume_recorder(terminal)
    terminal.wait_for("press r to arm again")
    if late:
        terminal.wait_for("r was pressed before the question was shown")
    time.sleep(0.5)
    assert shared.state == "waiting"
    terminal.press(b"r")
    patient(lambda: shared.state == "running")
    terminal.press(b" ")
    assert terminal.end() == 0


def test_a_key_that_the_recorder_takes_long_after_the_question_arms_nothing(tmp_path, terminal):
    write(tmp_path, FRAGILE, "fragile.py")
    terminal.run("fragile.py", "--rearm", "--no-record", cwd=tmp_path)
    terminal.wait_for("lists the keys")
    shared = shared_state_of(terminal.process.pid)
    (tmp_path / "break").touch()
    terminal.wait_for("press r to arm again")
    time.sleep(0.1)
    suspend_recorder(terminal)
    terminal.answer(b"r", NOT_TAKEN)
    time.sleep(0.3)
    resume_recorder(terminal)
    terminal.wait_for(r"r was pressed \d\.\d s ago: press it again")
    assert shared.state == "waiting"
    terminal.press(b" ")
    assert terminal.end() == 3 and terminal.attributes == terminal.before
