"""The fence of another process is permanent: nothing in the control process lowers it."""

import os
import signal
import struct
import subprocess
import sys

import pytest

from blocks.sources import Constant
from cext.memory.shared_state import SharedState
from tests.cext.clock.test_signals import ENVIRONMENT, ROOT
from tests.cext.rigs import one_drive

FENCE = struct.Struct("=QQii")  # magic, capacity, state, fence
FOR_GOOD = 2

CRASHES = """
import os, sys
from cext.memory.shared_state import SharedState
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig

class Crash(Block):
    "Crashes in tick 5."
    y = Output("1")
    def step(self, tick):
        if tick == 5:
            if sys.argv[2] == "fenced":
                shared.raise_fence()
            os.abort()
        return 0.0

shared = SharedState(fd=int(sys.argv[1]))
with Diagram("robot", rate=100) as robot:
    Crash(name="crash")()
Rig(robot, shared=shared).run(20)
"""


def fence_of(shared):
    return FENCE.unpack(os.pread(shared.fd, FENCE.size, 0))[3]


def crash(*words):
    """The shared state of a process that has crashed in a tick."""
    shared = SharedState(1 << 16)
    process = subprocess.run(
        [sys.executable, "-c", CRASHES, str(shared.fd), *words],
        cwd=ROOT,
        env=ENVIRONMENT,
        pass_fds=[shared.fd],
        capture_output=True,
        text=True,
    )
    assert process.returncode == -signal.SIGABRT, process.stderr
    return shared


def test_a_crash_raises_the_fence_for_good():
    """A run that has crashed is never armed again, also not by a thread that goes on for a moment."""
    shared = crash("unfenced")
    assert fence_of(shared) == FOR_GOOD and shared.crashed == signal.SIGABRT


@pytest.mark.hazard("H8e")
def test_a_crash_does_not_lower_the_fence_of_the_guardian():
    shared = crash("fenced")
    assert fence_of(shared) == FOR_GOOD


def test_the_next_run_does_not_lower_the_fence_of_another_process():
    rig = one_drive(lambda knee: Constant(0.0)())
    assert rig.run(20).status == "ok" and rig.run(20).status == "ok"  # its own, of the stop, is lowered
    rig.shared.raise_fence()
    assert rig.run(20).status == "fenced" and fence_of(rig.shared) == FOR_GOOD
