"""Processes that are forked for tests, started from several threads of one test."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.runtime.forked import Forked
from tests.runtime.runs import environment, server


def test_each_thread_gets_the_process_that_it_has_started():
    """Otherwise it kills that of another thread, and waits for its own for ever."""

    def start(number):
        words = ["-c", f"import os, time\nprint(os.getpid(), {number}, flush=True)\ntime.sleep(60)"]
        how = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        process = Forked(server(), words, env=environment(), **how)
        said = process.stdout.readline()
        process.kill()
        process.communicate(timeout=10)
        return said.split() == [str(process.pid), str(number)]

    switching = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # s: threads take turns within `fork`
    try:
        with ThreadPoolExecutor(8) as threads:
            assert all(threads.map(start, range(48)))
    finally:
        sys.setswitchinterval(switching)


@pytest.mark.soak
def test_threads_share_one_server():
    code = "from tests.runtime.runs import server\nfrom concurrent.futures import ThreadPoolExecutor\n"
    code += "with ThreadPoolExecutor(8) as threads:\n    print(len(set(threads.map(lambda _: server(), range(8)))))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.stdout == "1\n", run
