"""Death of a process that owns the mutex of the shared state is detected: with real, killed processes."""

import os
import select
import signal
import subprocess
import sys

import pytest

from cext.memory.shared_state import SharedState
from cext.safety.owner_death import OwnerDeathWatcher

HOLDER = """
import sys
from cext.memory.shared_state import SharedState

shared = SharedState(fd=int(sys.argv[1]))
shared.take_hold()
print("held", flush=True)
sys.stdin.readline()
shared.let_go()
print("gone", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def shared():
    return SharedState(1 << 12)


@pytest.fixture
def holder(shared):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(shared.fd)],
        pass_fds=[shared.fd],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdin.close()
    process.stdout.close()


def is_told(mourner, seconds):
    return bool(select.select([mourner.fd], [], [], seconds)[0])


def test_death_of_mutex_owner_is_reported(shared, holder):
    mourner = OwnerDeathWatcher(shared)
    assert not is_told(mourner, 0.05)
    holder.send_signal(signal.SIGSTOP)
    assert not is_told(mourner, 0.05)  # it stands still, and is there
    holder.kill()
    assert is_told(mourner, 5.0)


def test_owner_death_before_wait_is_reported(shared, holder):
    holder.kill()
    holder.wait()
    assert is_told(OwnerDeathWatcher(shared), 5.0)


def test_death_after_mutex_release_is_not_reported(shared, holder):
    mourner = OwnerDeathWatcher(shared)
    print(file=holder.stdin, flush=True)
    assert holder.stdout.readline() == "gone\n"
    holder.kill()
    holder.wait()
    assert not is_told(mourner, 0.1)


def test_the_loops_mutex_belongs_to_one_process_and_is_recursive(shared, holder):
    with pytest.raises(OSError, match="another thread holds the loop's mutex"):
        shared.take_hold()
    mine = SharedState(1 << 12)
    mine.take_hold()
    mine.take_hold()
    mine.let_go()
    mine.let_go()
    os.fstat(mine.fd)
