"""Ctrl-C in a program that calls Tickwork: one line and no traceback, whatever the call is doing."""

import itertools
import os
import re
import signal
import subprocess
import sys
import time

import pytest

import runtime
from runtime.session import simulate
from tests.runtime.runs import environment, knee
from tests.soaking import soaked

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
# It is interrupted while it imports NetworkX, as soon as that is complete, and repeated.
HALF_A_LIBRARY = """
import signal, threading
def interrupt():
    while "networkx.utils" not in sys.modules:
        time.sleep(0.0)
    signal.raise_signal(signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    while True: runtime.check(sys.argv[1])
except KeyboardInterrupt:
    print("interrupted")
print(runtime.check(sys.argv[1])["ok"])
"""
SLOW_LOOP = """
with runtime.connect(sys.argv[1], fast=False, loop_timeout=20.0) as robot:
    for tick in robot:
        print("in the loop", flush=True)
        time.sleep(20.0)
"""
# Python handles signals where a function begins: one that came before the call, in the program's code, is shown there.
BEGIN_OF_CALL = re.compile(r' +File "[^"]+/runtime/host/interrupts\.py", line \d+, in call\n +def call\(.*\n')
OWN = "runtime.check(sys.argv[1]); print('checked', flush=True); time.sleep(20.0)"

MOMENTS = soaked([0.02 * step for step in range(20)] + [0.5, 0.7, 1.0, 1.5], but=[7, 22])  # s, of the start


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


@pytest.mark.parametrize("after", MOMENTS)
def test_a_run_in_real_time_is_stopped_without_a_traceback(tmp_path, after):
    assert_ends_with_one_line(Program(tmp_path, REAL_TIME, as_file=True), after)


@pytest.mark.parametrize("name, after", soaked(list(itertools.product(CALLS, [0.0, 0.1, 0.3, 0.8])), but=[4, 11]))
def test_every_other_call_is_stopped_without_a_traceback(tmp_path, name, after):
    assert_ends_with_one_line(Program(tmp_path, CALLS[name]), after)


@pytest.mark.soak
def test_a_loop_that_is_interrupted_in_the_programs_own_code_names_its_recording(tmp_path):
    program = Program(tmp_path, SLOW_LOOP)
    assert "in the loop\n" in iter(program.process.stdout.readline, "")
    _, errors = program.interrupted()
    found = re.fullmatch(r"tickwork: stopped by Ctrl-C: the run was stopped; its recording is (\S+)\n", errors)
    assert found and runtime.load(tmp_path / found[1]).complete


def test_an_interrupt_does_not_leave_half_a_library_to_the_next_call(tmp_path):
    program = Program(tmp_path, HALF_A_LIBRARY)
    assert program.process.communicate(timeout=30) == ("interrupted\nTrue\n", "")


def test_a_module_of_the_users_is_interrupted_while_it_is_imported(tmp_path):
    (tmp_path / "slow.py").write_text("import time\nprint('imported', flush=True)\ntime.sleep(300.0)\n")
    (tmp_path / "slow_robot.py").write_text("import slow\n")
    program = Program(tmp_path, "runtime.check('slow_robot.py')")
    assert program.process.stdout.readline() == "imported\n"
    _, errors = program.interrupted()
    assert errors == "tickwork: stopped by Ctrl-C\n" and program.process.returncode == -signal.SIGINT


def test_an_interrupt_while_a_class_of_the_diagram_is_made_is_not_an_error_of_the_diagram(tmp_path):
    diagram = tmp_path / "interrupted.py"
    diagram.write_text(
        "class Name:\n    def __set_name__(self, owner, name):\n        raise KeyboardInterrupt\n"
        "class Law:\n    name = Name()\n"
    )
    with pytest.raises(KeyboardInterrupt):
        runtime.check(diagram)


class Interrupting:
    """Profile function that raises KeyboardInterrupt where Python handles signals: at the begin of a function of a
    file, and after it has called a function in C. count : which of these places
    """

    def __init__(self, file, count):
        self.file, self.left = file, count

    def __call__(self, frame, event, argument):
        if frame.f_code.co_filename == self.file and event in ("call", "c_return"):
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt


def test_an_interrupt_at_any_place_of_a_step_ends_the_loop_with_a_safe_stop(tmp_path):
    path = knee(tmp_path)
    for count in itertools.count(1):
        robot = runtime.connect(path)
        loop = iter(robot)
        next(loop)
        profile = Interrupting(simulate.__file__, count)
        sys.setprofile(profile)
        try:
            next(loop)
        except KeyboardInterrupt:
            assert profile.left == 0 and robot.state == "safe" and robot.trial.tick.tolist() in ([0], [0, 1])
        else:
            break
        finally:
            sys.setprofile(None)
    assert profile.left > 0 and count > 10


@pytest.mark.soak
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
