"""Every command ends soon after a signal, and leaves neither a process nor a file behind, however it ends."""

import os
import random
import select
import signal
import subprocess
import sys
import time

import psutil
import pytest

from runtime.host.ending import ENDING_SIGNALS, Interrupted, raise_if_ended_by_signal
from tests.runtime.runs import ROOT, descendant, environment, finished, knee, started, write
from tests.runtime.terminals import patient
from tests.soaking import soaked

LIMIT, LIMIT_BUSY = 0.15, 1.0  # s from a signal to the end of the command: at most 0.125 s on a slow machine; when busy
PROMPT = 5.0  # s of a command that ends, of the hour that it would take, on a machine however busy
TRIES = 4  # until one ends in time: another process may have the processor in the others

HOSTILE = """

class Broken(Exception):
    def __str__(self):
        while True:
            pass
"""


def took(process, number):
    """s from a signal to the end of a process."""
    poll = select.poll()
    poll.register(os.pidfd_open(process.pid), select.POLLIN)
    at = time.monotonic()
    process.send_signal(number)
    poll.poll(60_000)
    seconds = time.monotonic() - at
    process.wait(1)
    return seconds


def processor_time(process, number):
    """s of processor time from a signal to the end of a process, which other load does not lengthen."""
    before = psutil.Process(process.pid).cpu_times()
    os.kill(process.pid, number)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime - before.user - before.system


AGAIN = """
import os, signal, time
import runtime.__main__ as program
from runtime.host import ending

ending.RETRY_PERIOD = 1e-4
def interrupted(folder):
    ending.raise_on_signals()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(1.0)
program._start = interrupted
program.main()
"""


@pytest.mark.soak
def test_an_interrupt_that_is_raised_again_and_again_does_not_change_the_end():
    """A busy machine holds the process up for more than a period at any of its lines."""
    for _ in range(10):
        done = subprocess.run([sys.executable, "-c", AGAIN], cwd=ROOT, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (128 + signal.SIGTERM, "")


def limit():
    """s from a signal to the end of the command; a busy machine has more."""
    return LIMIT_BUSY if os.getloadavg()[0] > os.cpu_count() else LIMIT


def await_file(path, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert path.exists(), path
    time.sleep(0.2)  # a signal between the last check of the interpreter and its system call would wait for the latter


def await_one(folder, pattern, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not list(folder.glob(pattern)) and time.monotonic() < deadline:
        time.sleep(0.005)
    assert list(folder.glob(pattern)), pattern


def knee_that(folder, expression):
    """A robot that evaluates an expression in tick 20, or later if that is lost, and then creates the file `there`."""
    law = f"""if tick >= 20 and not hasattr(self, "evaluated"):
            self.evaluated = True
            {expression}
        tick >= 30 and open("there", "w").close()
        return 1.0"""
    path = knee(folder, law)
    path.write_text(path.read_text().replace("import math", "import atexit, math, threading, time" + HOSTILE))
    return path


@pytest.mark.timing
@pytest.mark.parametrize("number", soaked(ENDING_SIGNALS, but=[0, 1]), ids=lambda number: number.name)
def test_a_run_ends_within_150_ms_of_every_signal_with_a_summary(tmp_path, number):
    """One of its blocks raises an exception whose text never returns."""
    path = knee_that(tmp_path, "(_ for _ in ()).throw(Broken())")
    path.write_text(path.read_text().replace('Law(name="law")', 'Law(hold_exceptions=3, name="law")'))
    times, in_time = [], False
    while not in_time and len(times) < TRIES:
        process = started(path, "--record", "out", cwd=tmp_path)
        await_file(tmp_path / "there")
        times.append(took(process, number))
        in_time = times[-1] < limit()
        out, err = process.communicate()
        assert process.returncode == 128 + number, err
        assert "law held 1 exception" in out and f"stopped by {number.name}" in err, out + err
        (tmp_path / "there").unlink()
    assert in_time, times


@pytest.mark.parametrize("value", ["Endless()", "(Endless(), 1.0)"])
def test_a_run_ends_although_the_representation_of_a_returned_value_never_returns(tmp_path, value):
    path = knee(tmp_path, f"return {value} if tick == 20 else 1.0")
    endless = "\n\nclass Endless:\n    def __repr__(self):\n        while True:\n            pass\n"
    path.write_text(path.read_text().replace("import math", "import math" + endless))
    process = finished(path, "--fast", "--duration", "1", "--no-record", cwd=tmp_path, timeout=20)
    assert process.returncode == 3 and "no text within 20 ms" in process.stderr, process.stderr


def test_a_thread_of_user_code_that_never_ends_does_not_keep_the_process(tmp_path):
    path = knee_that(tmp_path, "threading.Thread(target=threading.Event().wait).start()")
    process = finished(path, "--fast", "--duration", "1", "--no-record", cwd=tmp_path)
    assert process.returncode == 0 and "200 of 200 done" in process.stdout


def test_files_that_user_code_has_left_open_are_written_and_its_exit_handlers_called(tmp_path):
    path = knee_that(tmp_path, "atexit.register(print, 'exit handler')")
    path.write_text(path.read_text() + "\ndiagram.log = open('log', 'w')\ndiagram.log.write('a line')\n")
    process = finished(path, "--fast", "--duration", "1", "--no-record", cwd=tmp_path)
    assert process.returncode == 0 and process.stdout.endswith("exit handler\n")
    assert (tmp_path / "log").read_text() == "a line"


def test_a_signal_ends_an_exit_handler_that_hangs(tmp_path):
    path = knee_that(tmp_path, "atexit.register(lambda: (open('hangs', 'w').close(), time.sleep(3600)))")
    process = started(path, "--fast", "--duration", "1", "--no-record", cwd=tmp_path)
    await_file(tmp_path / "hangs")
    assert took(process, signal.SIGINT) < PROMPT and process.returncode == 0
    process.communicate()


@pytest.mark.parametrize("number", soaked([signal.SIGINT, signal.SIGTERM], but=[0]), ids=lambda number: number.name)
def test_a_search_for_the_highest_rate_ends_with_a_signal(tmp_path, number):
    process = started("rate", "--seconds", "3600", "--low", "3900", "--actuators", "1", cwd=tmp_path, cold=True)
    assert "highest rate" in process.stdout.readline() + process.stdout.readline()
    time.sleep(0.5)
    assert processor_time(process, number) < PROMPT
    _, err = process.communicate()
    assert process.returncode == 128 + number and "stopped by " in err and "Traceback" not in err


@pytest.mark.parametrize("number", soaked([signal.SIGTERM, signal.SIGKILL], but=[1]))
def test_emulated_drives_end_with_their_benchmark(tmp_path, number):
    process = started("bench", "bus", cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    patient(lambda: descendant(process.pid, "runtime.setup.bench.drives"), 60.0)
    everybody = psutil.Process(process.pid).children(recursive=True)
    took(process, number)
    _, alive = psutil.wait_procs(everybody, timeout=2)
    assert not [each for each in alive if each.status() != psutil.STATUS_ZOMBIE]


SLOW_LAW = """import os, time
        if tick == 20:
            open("there", "w").close()
        if os.path.exists("slow"):
            time.sleep(1e-3)
        return 1.0"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of two minutes; its robot touches the file `there` in tick 20, and is slow where it finds `slow`."""
    folder = tmp_path_factory.mktemp("recording")
    path = knee(folder, SLOW_LAW)
    assert finished(path, "--fast", "--duration", "120", cwd=folder).returncode == 0
    [recording] = (folder / "recordings").glob("*.mcap")
    return recording


@pytest.mark.parametrize("number", soaked(ENDING_SIGNALS, but=[0]), ids=lambda number: number.name)
def test_a_replay_that_is_interrupted_leaves_no_file(recording, tmp_path, number):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    (tmp_path / "slow").touch()
    cold = number == signal.SIGINT  # for which Python itself installs a handler
    process = started("replay", recording, cwd=tmp_path, cold=cold, env=environment(TMPDIR=str(scratch)))
    await_file(tmp_path / "there")
    took(process, number)
    _, err = process.communicate()
    assert process.returncode == 128 + number and "stopped by " in err and "Traceback" not in err
    assert not list(scratch.iterdir()) and {path.name for path in tmp_path.iterdir()} == {"scratch", "slow", "there"}


SLOW_SINK = """
import os, time
from graph import Sink
from runtime.record.recorder.service import Service


class SlowService(Service):
    def open(self):
        path = os.path.join(self.plan["folder"], self.plan["stem"] + ".slow")
        self.files[path] = "of a slow disk"
        open(path, "w").close()
        time.sleep(60.0)


class Slow(Sink):
    service = "slow_sink:SlowService"
    writes_files = True
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGUSR1])
def test_a_signal_while_the_recorder_opens_its_files_leaves_none(tmp_path, number):
    path = knee(tmp_path)
    write(tmp_path, SLOW_SINK, "slow_sink.py")
    path.write_text(path.read_text().replace("import math", "import math\nfrom slow_sink import Slow") + "    Slow()\n")
    process = started(path, "--record", "out", cwd=tmp_path)
    await_one(tmp_path, "out/*.slow")
    children = psutil.Process(process.pid).children(recursive=True)
    seconds = took(process, number)
    _, alive = psutil.wait_procs(children, timeout=1.0)
    _, err = process.communicate()
    assert process.returncode == 128 + number and "stopped by " in err and "Traceback" not in err
    assert not [each for each in alive if each.status() != psutil.STATUS_ZOMBIE]
    assert not (tmp_path / "out").exists() and seconds < PROMPT


def test_an_outcome_that_a_signal_has_ended_is_an_interrupt_with_its_number():
    outcome = type("Outcome", (), {"signal": 0})()
    assert raise_if_ended_by_signal(outcome) is outcome
    outcome.signal = signal.SIGTERM
    with pytest.raises(Interrupted) as interrupted:
        raise_if_ended_by_signal(outcome)
    assert interrupted.value.number == signal.SIGTERM and not isinstance(interrupted.value, Exception)


def test_a_signal_that_is_ignored_by_the_shell_stays_ignored(tmp_path):
    """As under nohup."""
    script = write(
        tmp_path,
        "import signal\nfrom runtime.host.ending import leave_on_signals, raise_on_signals\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "leave_on_signals()\nraise_on_signals()\nassert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN\n"
        "import os\nos.kill(os.getpid(), signal.SIGHUP)\nprint('alive')\n",
        "script.py",
    )
    done = subprocess.run([sys.executable, script], env=environment(), capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "alive\n", done.stderr


def caught(pid, number):
    """Whether a process handles a signal."""
    with open(f"/proc/{pid}/status") as file:
        mask = next(line.split()[1] for line in file if line.startswith("SigCgt:"))
    return bool(int(mask, 16) >> (number - 1) & 1)


def await_handlers(process):
    """Wait until the first lines of Tickwork are run: Python itself handles SIGINT, with a traceback, and no other."""
    while process.poll() is None and not caught(process.pid, signal.SIGUSR1):
        time.sleep(0.0005)


STARTS = ("check", "run", "rate", "bench", "plot", "convert")


@pytest.mark.timing
@pytest.mark.parametrize("starts", [2, pytest.param(40, marks=pytest.mark.soak)])
@pytest.mark.parametrize("command", soaked(STARTS, but=[0]))
def test_a_signal_at_any_time_of_the_start_ends_the_command(recording, tmp_path, command, starts):
    path, draw = knee(tmp_path), random.Random(STARTS.index(command))
    arguments = {
        "check": [path],
        "run": [path, "--duration", "60", "--no-record"],
        "plot": [recording],
        "convert": [recording, "--to", "csv"],
    }.get(command, [])
    times = []
    for _ in range(starts):
        number = draw.choice(ENDING_SIGNALS)
        process = started(command, *arguments, cwd=tmp_path, cold=True)
        await_handlers(process)
        time.sleep(draw.uniform(0.0, 0.6))
        if process.poll() is None:
            times.append(took(process, number))
        _, err = process.communicate()
        assert "Traceback" not in err and "Exception ignored" not in err, err
        if process.returncode == 0:  # it had finished
            assert command in ("check", "plot", "convert") and "stopped by" not in err, err
        else:
            assert process.returncode == 128 + number and "stopped by" in err, (process.returncode, err)
    times.sort()
    most = limit() if starts > TRIES else PROMPT  # another process may have the processor in one of few
    assert not times or times[(len(times) - 1) * 3 // 4] < most, times


INTERRUPTING = """
import builtins, os, signal

usual = builtins.__import__


def interrupting(name, *arguments, **named):
    if name == "runtime.host":
        os.kill(os.getpid(), signal.SIGINT)
    return usual(name, *arguments, **named)


builtins.__import__ = interrupting
"""


def test_ctrl_c_during_the_first_imports_prints_no_traceback(tmp_path):
    write(tmp_path, INTERRUPTING, "sitecustomize.py")
    process = finished("check", cwd=tmp_path, PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert (process.returncode, process.stderr) == (-signal.SIGINT, "")


SWALLOWING = """
import time, warnings


class Cleanup:
    def __del__(self):
        open("there", "w").close()
        time.sleep(10.0)


{statement}
open("continued", "w").close()
time.sleep(10.0)
"""


@pytest.mark.parametrize(
    "statement",
    [
        "Cleanup()",
        "try:\n    Cleanup.__del__(None)\nexcept BaseException:\n    pass",
        "try:\n    Cleanup.__del__(None)\nexcept BaseException:\n    raise ImportError('numpy') from None",
    ],
)
def test_an_interrupt_that_other_code_swallows_or_replaces_still_ends_the_command(tmp_path, statement):
    path = write(tmp_path, SWALLOWING.format(statement=statement))
    process = started("check", path, cwd=tmp_path)
    await_file(tmp_path / "there")
    seconds = took(process, signal.SIGTERM)
    _, err = process.communicate()
    assert process.returncode == 128 + signal.SIGTERM and seconds < PROMPT, (process.returncode, seconds)
    assert err == "tickwork: stopped by SIGTERM; nothing is armed\n"


def test_an_interrupt_is_not_raised_again_while_it_is_handled(tmp_path):
    path = write(
        tmp_path,
        "import time\ntry:\n    open('there', 'w').close()\n    time.sleep(10.0)\n"
        "finally:\n    time.sleep(0.3)\n    open('cleaned', 'w').close()\n",
    )
    process = started("check", path, cwd=tmp_path)
    await_file(tmp_path / "there")
    took(process, signal.SIGHUP)
    _, err = process.communicate()
    assert process.returncode == 128 + signal.SIGHUP and (tmp_path / "cleaned").exists(), err
