"""Processes that a block has started end with its run, however it ends."""

import os
import signal
import time

import pytest

from runtime.host.run_mark import own_mark, remove_mark, set_mark
from tests.runtime.host.test_ending import await_file
from tests.runtime.runs import knee, started

STARTS = """
import math, os, subprocess, time
from pathlib import Path


def fork(detached=False):
    '''Fork a process that sleeps. detached : with another parent and session, no descriptors and no environment'''
    pid = os.fork()
    if pid == 0:
        if detached:
            os.setsid()
            if os.fork():
                os._exit(0)
        Path(f"pid-{os.getpid()}").touch()
        if detached:
            os.closerange(0, 1024)
            os.execve("/bin/sleep", ["sleep", "100"], {})
        time.sleep(100.0)
        os._exit(0)


def start():
    fork()
    fork(detached=True)
    for how in ({}, {"env": {}, "start_new_session": True}):
        Path(f"pid-{subprocess.Popen(['/bin/sleep', '100'], **how).pid}").touch()
    while len(list(Path().glob("pid-*"))) < 4:
        time.sleep(0.001)
    Path("started").touch()
"""


def lives(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.paced  # four processes are started within one tick
@pytest.mark.parametrize("number", [0, signal.SIGTERM, signal.SIGKILL])
def test_processes_that_a_block_has_started_end_with_the_run(tmp_path, number):
    path = knee(tmp_path, "if tick >= 20 and not hasattr(self, 'begun'): self.begun = start()\n        return 1.0")
    path.write_text(path.read_text().replace("import math", STARTS, 1))
    run = started(path, *(["--duration", "0.2"] if number == 0 else []), "--record", "out", cwd=tmp_path)
    await_file(tmp_path / "started")
    if number:
        run.send_signal(number)
    code, (_, error) = run.wait(30), run.communicate()
    assert code == {0: 0, signal.SIGTERM: 143, signal.SIGKILL: -9}[number], error
    deadline = time.monotonic() + 1.0
    processes = [int(file.name.partition("-")[2]) for file in tmp_path.glob("pid-*")]
    assert len(processes) == 4, error
    while any(map(lives, processes)) and time.monotonic() < deadline:
        time.sleep(0.01)
    left = [process for process in processes if lives(process)]
    for process in left:
        os.kill(process, signal.SIGKILL)
    assert not left


def test_a_process_owns_the_mark_that_it_has_set_and_none_that_it_inherits():
    reader, pipe = os.pipe()
    if os.fork() == 0:
        set_mark()
        mark, parent = own_mark(), os.getpid()
        if os.fork() == 0:
            inherited = own_mark() is None and own_mark(parent) == mark is not None
            remove_mark()
            os.write(pipe, b"yes" if inherited and own_mark(parent) is None else b"no")
            os._exit(0)
        os._exit(0)
    os.close(pipe)
    with open(reader) as answer:
        assert answer.read() == "yes"
