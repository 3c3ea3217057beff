"""Time from the death of one of the two processes of a run to the stop of its motors by the other.

The run, at 200 Hz, has two emulated drives on udp_multicast. Each death is that of another run.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.host.system import end_with_parent
from runtime.setup.bench import bus
from runtime.setup.bench.drives import node

if TYPE_CHECKING:
    from can import BusABC

GUARDIAN = "tickwork-guard"  # name of its process
STOP_TIMEOUT = 1.0  # s
RELEASE_TIMEOUT = 5.0  # s until a guardian has released the bus of a killed run
DISABLE = bytes.fromhex("fffffffffffffffd")

START_TIMEOUT = 10.0  # s until a run commands torque
WAITS = """
import os, sys
import blocks.families, can, runtime.cli.run, runtime.robot.rig, runtime.session.session
import runtime.robot.loading.simulation
from runtime.__main__ import main
print("ready", flush=True)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
sys.stdin.read()
main()
"""

ROBOT = """
from blocks.families import benchmark
from blocks.limiters import TorqueLimiter
from blocks.sources import Sine
from graph import Diagram

with Diagram("bench", rate=200) as diagram:
    torque = TorqueLimiter(limit=5.0)(Sine(amplitude=3.0, frequency=1.0)())
    for can_id in (1, 2):
        typical = benchmark("can")
        place = {"bus": "legs", "can_id": can_id, "range": (-1.0, 1.0), "wake_shift": 0.0, "name": f"knee{can_id}"}
        knee = typical.block(**typical.parameters, **place)
        knee(torque_command=torque)
"""


@dataclass(frozen=True)
class Case:
    """guardian : whether the guardian, not the control process, gets the signal `number`
    realtime : option of the run; priority : whether its guardian must have a real-time priority
    """

    guardian: bool
    number: int = signal.SIGKILL
    realtime: str = "try"
    priority: bool = False


CASES = {
    "the control process, killed": Case(guardian=False),
    "the guardian, killed": Case(guardian=True),
    "the guardian, kill -STOP, real-time priority": Case(guardian=True, number=signal.SIGSTOP, priority=True),
    "the guardian, kill -STOP, without one": Case(guardian=True, number=signal.SIGSTOP, realtime="off"),
}


def deaths(count: int) -> tuple[dict[str, list[float]], list[float]]:
    """Measure every case `count` times, in turn.

    Returns ({name of CASES: s from each signal to the first stop frame of the later drive, inf where one did not come},
    load averages of the last minute, at each). A case that needs a real-time priority is empty where none is granted.
    """
    times: dict[str, list[float]] = {name: [] for name in CASES}
    loads = []
    group = bus.channel()
    with bus.drives(group, 1, 2), tempfile.TemporaryDirectory() as folder:
        robot, rig = Path(folder, "robot.py"), Path(folder, "rig.toml")
        robot.write_text(ROBOT)
        rig.write_text(f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{group}"\n')
        listener = node(group)
        cases = [*CASES.items()] * count
        with ExitStack() as stack:
            stack.callback(listener.shutdown)
            runs = (stack.enter_context(run_on_rig(robot, rig, "--realtime", case.realtime)) for _, case in cases)
            later: subprocess.Popen[str] | None = next(runs)
            for name, case in cases:
                assert later is not None
                run, later = later, next(runs, None)  # which imports while this one arms
                times[name] += one_death(listener, run, later, case)
                loads.append(os.getloadavg()[0])
    return times, loads


@contextmanager
def run_on_rig(robot: Path, rig: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Context manager of a run on a rig, armed without confirmation, which waits for the end of its standard input.

    It prints a line once it has imported what a run imports, and then waits for that end.

    robot, rig : paths of their files
    words : further options
    """
    process = subprocess.Popen(
        [sys.executable, "-c", WAITS, str(robot), "--rig", str(rig), "--yes", "--no-record", *words],
        cwd=Path(__file__).parents[2],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        preexec_fn=end_with_parent,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def one_death(
    listener: BusABC, process: subprocess.Popen[str], later: subprocess.Popen[str] | None, case: Case
) -> list[float]:
    """Return [s to the first stop frame of the later drive of a run]; inf without one.

    [] without the priority, and if a busy machine has ended the run before.

    later : the next run, which waits before the signal
    """
    guardian = None
    assert process.stdin is not None and process.stdout is not None
    while listener.recv(0) is not None:  # frames of the run before
        pass
    try:
        process.stdin.close()
        deadline = time.monotonic() + START_TIMEOUT
        while not any(data[:7] != b"\xff" * 7 and data != bus.COMMAND for _, _, data in frames(listener, 0.02)):
            if time.monotonic() > deadline or process.poll() is not None:
                raise OSError("the run under test did not start")
        guardian = guardian_of(process.pid)
        if case.priority and os.sched_getparam(guardian).sched_priority == 0:
            return []
        if later is not None and later.stdout is not None:
            later.stdout.readline()
        time.sleep(random.uniform(0.02, 0.06))  # somewhere in a period
        if any(data == DISABLE for _, _, data in frames(listener, 0.0)):
            return []
        killed = time.time()
        os.kill(guardian if case.guardian else process.pid, case.number)
        first: dict[int, float] = {}
        while len(first) < 2 and time.time() < killed + STOP_TIMEOUT:
            for at, identifier, data in frames(listener, 0.01):
                if data == DISABLE:
                    first.setdefault(identifier, at - killed)
        return [max(first.values()) if len(first) == 2 else float("inf")]
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        if guardian is not None:
            end(guardian, at_once=case.guardian)


def end(guardian: int, at_once: bool) -> None:
    """Wait until a guardian has released the bus. at_once : kill it, as after its own stop"""
    deadline = time.monotonic() + RELEASE_TIMEOUT
    with suppress(OSError):  # it has ended
        while name_and_parent(guardian)[0] == GUARDIAN:
            if at_once or time.monotonic() > deadline:
                os.kill(guardian, signal.SIGKILL)
            time.sleep(0.005)


def frames(listener: BusABC, seconds: float) -> Iterator[tuple[float, int, bytes]]:
    """Yield (s of the wall clock, id, data) of the frames to the drives that arrive within a time."""
    deadline = time.monotonic() + seconds
    while (message := listener.recv(max(0.0, deadline - time.monotonic()))) is not None:
        data = bytes(message.data)
        if data[0] != message.arbitration_id:
            yield message.timestamp, message.arbitration_id, data


def guardian_of(pid: int) -> int:
    """Return the process number of a run's guardian."""
    for entry in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError):
            if name_and_parent(int(entry)) == (GUARDIAN, pid):
                return int(entry)
    raise OSError("the run has no guardian")


def name_and_parent(pid: int) -> tuple[str, int]:
    """Return the name of a process that has not ended, and the number of its parent. Raises OSError."""
    name, _, rest = Path("/proc", str(pid), "stat").read_text().partition("(")[2].rpartition(")")
    state, parent, *_ = rest.split()
    if state == "Z":
        raise ProcessLookupError(f"process {pid} has ended")
    return name, int(parent)
