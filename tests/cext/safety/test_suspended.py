"""A computer that is suspended in the middle of a run: no command follows.

The kernel shows a process of one thread a later CLOCK_BOOTTIME when it enters another time namespace, while
CLOCK_MONOTONIC goes on: what a process sees after a suspend.
"""

import json
import os
import subprocess
import sys

import pytest

from tests.runtime.runs import ROOT

ASLEEP = 3600  # s

SCRIPT = """
import ctypes, json, os, sys, time
from blocks.actuators.mit_frames import DISABLE
from cext.memory.shared_state import SharedState
from cext.safety.suspend import time_suspended
from tests.cext.rigs import ends_in_the_safe_stop
from tests.cext.safety.test_guarded import guarded

namespace, tick, guard = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])

def suspend():
    descriptor = os.open(namespace, os.O_RDONLY)
    assert ctypes.CDLL(None).setns(descriptor, 0x80) == 0

rig = guarded(suspend, tick, guard=guard)
if guard == 0.0:
    rig.shared.look_after(0)
outcome = rig.run(60)
print(json.dumps([outcome.status, outcome.culprit, outcome.tick, len(rig.commands()), ends_in_the_safe_stop(rig),
                  time_suspended(rig.shared) * 1e-9, rig.shared.fenced]))
"""


@pytest.fixture(scope="module")
def later():
    """File of a time namespace in which the computer was suspended for an hour."""
    holder = subprocess.Popen(
        ["unshare", "--time", "--fork", "--boottime", str(ASLEEP), "sh", "-c", "echo; exec cat"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    if not holder.stdout.readline():
        pytest.skip(f"no time namespace: {holder.stderr.read().decode().strip()}")
    with open(f"/proc/{holder.pid}/task/{holder.pid}/children") as children:
        child = int(children.read().split()[0])
    yield f"/proc/{child}/ns/time"
    holder.stdin.close()
    holder.wait()
    holder.stdout.close()
    holder.stderr.close()


def outcome_of(namespace, tick, guard=60.0):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    words = [sys.executable, "-c", SCRIPT, namespace, str(tick), str(guard)]
    run = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


@pytest.mark.hazard("H4d")
def test_a_suspend_within_a_tick_ends_the_run_before_the_commands_of_that_tick_are_sent(later):
    status, culprit, tick, commands, stopped, seconds, fenced = outcome_of(later, 20)
    assert (status, culprit, tick, commands) == ("suspended", None, 20, 20)
    assert stopped and fenced and seconds == pytest.approx(ASLEEP, abs=1.0)


def test_a_simulation_goes_on_after_a_suspend(later):
    status, _, tick, commands, *_ = outcome_of(later, 20, guard=0.0)
    assert (status, tick, commands) == ("ok", 59, 60)
