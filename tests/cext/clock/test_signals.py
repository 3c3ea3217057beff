"""Signals end a run in the safe stop, in real processes; afterwards Python's own handlers are back."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from cext.memory.shared_state import SharedState
from tests.soaking import soaked

pytestmark = pytest.mark.paced

ROOT = Path(__file__).parents[3]
# without threads of NumPy, which would receive the signals that the thread of the loop blocks
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}

ROBOT = """
import json, os, signal, sys, time
from cext.memory.shared_state import SharedState
from blocks.actuators import CubeMars
from graph import Block, Diagram, Input, Output
from tests.cext.rigs import Rig, plant_of

class Slow(Block):
    "Keeps Python busy for most of a tick."
    u = Input("N·m")
    y = Output("N·m", range=(-5.0, 5.0))

    def step(self, u):
        end = time.monotonic() + 0.003
        while time.monotonic() < end:
            pass
        return 5.0

class Ignoring(Slow):
    "Ignores what ends a run, in every step."
    def step(self, u):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1):
            signal.signal(number, signal.SIG_IGN)
        return 5.0

class Blocking(Slow):
    "Blocks every signal, in every step."
    def step(self, u):
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        return 5.0

class Forking(Slow):
    "Forks once; both processes return."
    children = 0
    def step(self, u):
        if u and self.children == 0:
            self.children = 1
            os.fork()
        return 5.0

heard = []
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR2):
    signal.signal(number, lambda number, frame: heard.append(number))
mine = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]

with Diagram("robot", rate=200) as robot:
    knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)
    kinds = {"slow": Slow, "ignoring": Ignoring, "blocking": Blocking, "forking": Forking}
    kind = kinds.get((sys.argv[3:] or [None])[0])
    knee(torque_command=kind()(knee.torque) if kind else 5.0)
rig = Rig(robot, None if "deaf" in sys.argv else plant_of(robot), shared=SharedState(fd=int(sys.argv[1])),
          virtual=False, spin=1.0 if "spin" in sys.argv else 0.0)
outcome = rig.run(int(sys.argv[2]), arming_timeout=20.0)
during = list(heard)
restored = mine == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
os.kill(os.getpid(), signal.SIGINT)
print(json.dumps({
    "status": outcome.status, "signal": outcome.signal, "tick": outcome.tick,
    "unconfirmed": outcome.unconfirmed, "state": rig.shared.state, "ticks": rig.tick.tolist(),
    "sent": [data.hex() for data in rig.sent()], "restored": restored, "during": during,
    "after": heard[len(during):], "statistics": rig.shared.statistics()}))
sys.stdin.read()                        # a signal that comes late finds Python's handlers still there
"""


def robot(*actions, ticks=-1, options=(), state="running", frames=20):
    """Start a robot in a process of its own; once it is in `state` and has sent so many frames, do the actions to it.
    What it tells.
    """
    shared = SharedState(1 << 22)
    child = subprocess.Popen(
        [sys.executable, "-c", ROBOT, str(shared.fd), str(ticks), *options],
        cwd=ROOT,
        env=ENVIRONMENT,
        pass_fds=[shared.fd],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 30
    while shared.state != state or shared.statistics()["frames"]["sent"] < frames:
        assert child.poll() is None and time.monotonic() < deadline, (
            child.stderr.read() if child.poll() is not None else "never came up"
        )
        time.sleep(0.002)
    for action in actions:
        action(child)
    out, err = child.communicate(timeout=30)
    assert child.returncode == 0, err
    return json.loads(out)


def sends(number):
    return lambda child: child.send_signal(number)


def stopped_safely(told):
    """Two rounds: the first may have been answered by what was on its way."""
    sent = [bytes.fromhex(data) for data in told["sent"]]
    return sent[-4:] == [NOTHING, DISABLE] * 2 and told["state"] == "safe" and sent.index(DISABLE) == len(sent) - 3


SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1]


@pytest.mark.parametrize("number", soaked(SIGNALS, but=[0]))
def test_a_signal_ends_in_zero_torque_then_disable_and_the_recording_is_complete(number):
    told = robot(sends(number))
    assert told["status"] == "ok" and told["signal"] == number and told["unconfirmed"] == []
    assert stopped_safely(told)
    statistics = told["statistics"]
    assert len(told["ticks"]) == statistics["ticks"] and told["ticks"][-1] == told["tick"] == statistics["last_tick"]
    assert len(told["ticks"]) + statistics["missed"] == told["tick"] + 1
    commands = [data for data in told["sent"] if bytes.fromhex(data) not in (ENABLE, DISABLE)]
    assert len(commands) == 1 + statistics["ticks"] + 2  # arming, one a tick, two rounds of the safe stop
    assert told["restored"] and told["during"] == [] and told["after"] == [signal.SIGINT]


def test_a_signal_while_arming_stops_without_a_command():
    told = robot(sends(signal.SIGTERM), options=["deaf"], state="arming", frames=4)
    assert (told["status"], told["signal"], told["tick"], told["ticks"]) == ("ok", signal.SIGTERM, -1, [])
    assert {bytes.fromhex(data) for data in told["sent"]} == {ENABLE, NOTHING, DISABLE} and bytes.fromhex(
        told["sent"][-1]
    ) == DISABLE
    assert told["unconfirmed"] == ["knee"]


def test_a_signal_in_the_middle_of_a_python_block_waits_for_the_end_of_its_tick():
    told = robot(sends(signal.SIGINT), options=["slow"])
    assert told["status"] == "ok" and told["signal"] == signal.SIGINT and stopped_safely(told) and told["restored"]


def test_a_signal_ends_a_run_that_spins_through_its_periods():
    told = robot(sends(signal.SIGTERM), options=["spin"])
    assert told["signal"] == signal.SIGTERM and stopped_safely(told) and told["statistics"]["sleeps"] == 0


def test_second_signal_does_not_shorten_safe_stop():
    told = robot(sends(signal.SIGHUP), sends(signal.SIGINT), sends(signal.SIGTERM))
    assert (
        told["signal"] in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
        and stopped_safely(told)
        and told["status"] == "ok"
    )


def test_an_unrelated_signal_neither_ends_the_run_nor_shortens_a_tick():
    told = robot(*[sends(signal.SIGUSR2)] * 5, ticks=100)
    assert (
        told["signal"] == 0
        and told["tick"] <= 99
        and len(told["ticks"]) + told["statistics"]["missed"] == 100
        and stopped_safely(told)
    )
    assert signal.SIGUSR2 in told["during"] + told["after"]


@pytest.mark.parametrize("how", soaked(["ignoring", "blocking"], but=[1]))
def test_a_block_that_ignores_or_blocks_signals_cannot_prevent_the_end_of_the_run(how):
    def twice(child):
        child.send_signal(signal.SIGINT)  # the first may fall into the step itself
        time.sleep(0.05)
        child.send_signal(signal.SIGINT)

    told = robot(twice, options=[how])
    assert told["status"] == "ok" and told["signal"] == signal.SIGINT and stopped_safely(told)


def test_a_forked_child_that_returns_to_the_loop_is_ended():
    shared = SharedState(1 << 22)
    done = subprocess.run(
        [sys.executable, "-c", ROBOT, str(shared.fd), "100", "forking"],
        cwd=ROOT,
        env=ENVIRONMENT,
        pass_fds=[shared.fd],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout.count("statistics") == 1 and done.stderr == (
        "tickwork: a block forked, and its child process returned to the loop: the child was ended, the run continues\n"
    )
    told = json.loads(done.stdout)
    assert told["status"] == "ok" and len(told["ticks"]) + told["statistics"]["missed"] == 100 and stopped_safely(told)
    assert told["ticks"] == sorted(set(told["ticks"]))


def test_continued_process_resumes_at_current_time():
    def pause(child):
        child.send_signal(signal.SIGSTOP)
        time.sleep(0.1)
        child.send_signal(signal.SIGCONT)
        time.sleep(0.05)

    told = robot(pause, sends(signal.SIGINT))
    assert told["statistics"]["missed"] >= 15 and stopped_safely(told)


EARLY = """
import ctypes, gc
from tests.cext.rigs import one_drive

# Ctrl-C just before the handlers are replaced: the destructor runs inside run()'s own garbage collection, where Python
# handles no signal.
new = ctypes.pythonapi.PyCapsule_New
new.restype, new.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
interrupt = ctypes.cast(ctypes.pythonapi.PyErr_SetInterrupt, ctypes.c_void_p).value
rig = one_drive(lambda knee: 1.0, virtual=True)
gc.disable()
cycle = [new(1, b"interrupt", interrupt)]
cycle.append(cycle)
del cycle
gc.enable()
try:
    rig.executor.run(10**6)
except KeyboardInterrupt:
    print("interrupted", rig.shared.statistics()["frames"]["sent"], rig.shared.state, gc.isenabled())
"""


def test_a_signal_just_before_the_run_is_not_lost():
    child = subprocess.run(
        [sys.executable, "-c", EARLY], cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, timeout=60
    )
    assert child.stdout == "interrupted 0 init True\n", child.stderr
