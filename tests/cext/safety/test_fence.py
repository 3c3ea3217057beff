"""The fence of another process is permanent: nothing in the control process lowers it."""

import os
import signal
import struct
import subprocess
import sys

import pytest

from blocks.sources import Constant
from cext.safety.shared_state import SharedState
from tests.cext.clock.test_signals import ENVIRONMENT, ROOT
from tests.cext.rigs import one_drive

FENCE = struct.Struct("=QQii")  # magic, capacity, state, fence
FOR_GOOD = 2

CRASHES = """
import os, sys
from cext.safety.shared_state import SharedState
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig

class Crash(Block):
    "Crashes in tick 5."
    y = Output("1")
    def step(self, tick):
        if tick == 5:
            if sys.argv[2] == "fenced":
                page.raise_fence()
            os.abort()
        return 0.0

page = SharedState(fd=int(sys.argv[1]))
with Diagram("robot", rate=100) as robot:
    Crash(name="crash")()
Rig(robot, page=page).run(20)
"""


def fence_of(page):
    return FENCE.unpack(os.pread(page.fd, FENCE.size, 0))[3]


def crash(*words):
    """The shared state of a process that has crashed in a tick."""
    page = SharedState(1 << 16)
    process = subprocess.run(
        [sys.executable, "-c", CRASHES, str(page.fd), *words],
        cwd=ROOT,
        env=ENVIRONMENT,
        pass_fds=[page.fd],
        capture_output=True,
        text=True,
    )
    assert process.returncode == -signal.SIGABRT, process.stderr
    return page


def test_a_crash_raises_the_fence_for_good():
    """A run that has crashed is never armed again, also not by a thread that goes on for a moment."""
    page = crash("unfenced")
    assert fence_of(page) == FOR_GOOD and page.crashed == signal.SIGABRT


@pytest.mark.hazard("H8e")
def test_a_crash_does_not_lower_the_fence_of_the_guardian():
    page = crash("fenced")
    assert fence_of(page) == FOR_GOOD


def test_the_next_run_does_not_lower_the_fence_of_another_process():
    rig = one_drive(lambda knee: Constant(0.0)())
    assert rig.run(20).status == "ok" and rig.run(20).status == "ok"  # its own, of the stop, is lowered
    rig.page.raise_fence()
    assert rig.run(20).status == "fenced" and fence_of(rig.page) == FOR_GOOD
