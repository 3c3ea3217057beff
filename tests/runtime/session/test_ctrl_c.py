"""Ctrl-C in a program that calls Tickwork: one line and no traceback, whatever the call is doing."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest

import runtime
from tests.runtime.runs import environment, knee

pytestmark = pytest.mark.paced

REAL_TIME = "runtime.run(sys.argv[1], 5.0, fast=False)"
CALLS = {
    "a run in virtual time": "runtime.run(sys.argv[1], 5000.0)",
    "a loop in real time": "with runtime.connect(sys.argv[1], fast=False) as robot:\n    for tick in robot: pass",
    "a loop in virtual time": "with runtime.connect(sys.argv[1]) as robot:\n    for tick in robot: pass",
    "steps": "sim = runtime.simulate(sys.argv[1])\nwhile True: sim.step()",
    "checks": "while True: runtime.check(sys.argv[1])",
    "studies": "while True: runtime.study(sys.argv[1], 500.0, "
    '{"rms": {"function": "rms", "signal": "knee.position"}}, workers=2)',
}
SLOW_LOOP = """
with runtime.connect(sys.argv[1], fast=False, loop_timeout=20.0) as robot:
    for tick in robot:
        print("in the loop", flush=True)
        time.sleep(20.0)
"""
# Python handles signals where a function begins: one that came before the call, in the program's code, is shown there.
BEGIN_OF_CALL = re.compile(r' +File "[^"]+/runtime/host/interrupts\.py", line \d+, in call\n +def call\(.*\n')
OWN = "runtime.check(sys.argv[1]); print('checked', flush=True); time.sleep(20.0)"


class Program:
    """A program that has reached its call."""

    def __init__(self, folder, call, as_file=False):
        text = f"import runtime, sys, time\nprint('begun', flush=True)\n{call}"
        (folder / "program.py").write_text(text)
        words = ["program.py"] if as_file else ["-c", text]
        self.process = subprocess.Popen(
            [sys.executable, *words, knee(folder)], cwd=folder, env=environment(), text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        assert self.process.stdout.readline() == "begun\n"

    def interrupted(self):
        """Press Ctrl-C, of which a terminal sends the signal to the whole group. Returns what is printed after it."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.process.communicate(timeout=30)


def assert_ends_with_one_line(program, after=0.0):
    time.sleep(after)
    _, errors = program.interrupted()
    errors = BEGIN_OF_CALL.sub("", errors)
    one_line = re.fullmatch(r"tickwork: stopped by Ctrl-C(: the run was stopped; its recording is \S+)?\n", errors)
    assert one_line or "runtime/" not in errors and errors.count("File") == 1, errors  # it was still at its print()
    assert program.process.returncode == -signal.SIGINT


@pytest.mark.parametrize("after", [0.02 * step for step in range(20)] + [0.5, 0.7, 1.0, 1.5])
def test_a_run_in_real_time_is_stopped_without_a_traceback(tmp_path, after):
    assert_ends_with_one_line(Program(tmp_path, REAL_TIME, as_file=True), after)


@pytest.mark.parametrize("after", [0.0, 0.1, 0.3, 0.8])
@pytest.mark.parametrize(
    "call",
    [  # a loop in virtual time has lost one of 160 interrupts, and went on until the next: its cause is not known
        pytest.param(call, id=name, marks=[pytest.mark.soak] if name == "a loop in virtual time" else [])
        for name, call in CALLS.items()
    ],
)
def test_every_other_call_is_stopped_without_a_traceback(tmp_path, call, after):
    assert_ends_with_one_line(Program(tmp_path, call), after)


def test_a_loop_that_is_interrupted_in_the_programs_own_code_names_its_recording(tmp_path):
    program = Program(tmp_path, SLOW_LOOP)
    assert "in the loop\n" in iter(program.process.stdout.readline, "")
    _, errors = program.interrupted()
    found = re.fullmatch(r"tickwork: stopped by Ctrl-C: the run was stopped; its recording is (\S+)\n", errors)
    assert found and runtime.load(tmp_path / found[1]).complete


def test_an_interrupt_outside_every_call_is_shown_by_python(tmp_path):
    program = Program(tmp_path, OWN)
    assert program.process.stdout.readline() == "checked\n"
    _, errors = program.interrupted()
    assert errors.startswith("Traceback") and errors.endswith("\nKeyboardInterrupt\n") and "runtime/" not in errors


def test_other_exceptions_go_to_the_hook_that_the_program_has_set(tmp_path):
    hook = "sys.excepthook = lambda kind, error, trace: print(f'hook {kind.__name__}')\n"
    then = "try:\n    sys.exit(signal.raise_signal(2))\nexcept KeyboardInterrupt: pass\n"
    program = Program(tmp_path, f"import signal\n{hook}sim = runtime.simulate(sys.argv[1])\n{then}1 / 0")
    assert program.process.communicate(timeout=30) == ("hook ZeroDivisionError\n", "")
