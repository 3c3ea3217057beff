"""Child processes of a run, which receive orders on standard input and answer with lines of JSON."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from runtime.host.descriptors import identity

_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

# Import the parent's own packages regardless of the working folder, then restore the parent's path for all others.
_BOOT = """
import os, sys
from importlib import import_module
module, root, numbers, path = sys.argv[1], sys.argv[2], sys.argv[3].split(","), sys.argv[4:]
sys.path[:] = [root, *path]
import cext, runtime
sys.path[:] = path
try:
    main = import_module(module).main
except Exception as error:
    from runtime.host.installation_check import damaged_cache
    problem = damaged_cache(error)
    if problem is None:
        raise
    sys.exit("tickwork: " + problem)
main(*map(int, numbers))
os._exit(0)  # the interpreter's own ending takes time that the parent waits for
"""


def import_path() -> list[str]:
    """Return the path from which this process imports, as absolute paths."""
    return [os.path.abspath(entry) for entry in sys.path]


class ChildProcess:
    """Child process, started at once in a session of its own.

    module : its `main` is called with two file descriptors (the pipe for answers, and a pidfd of this process), then
        `numbers`
    numbers : integers
    descriptors : file descriptors that the child inherits under the same numbers

    pid : ID of the process
    """

    def __init__(self, module: str, numbers: tuple[int, ...], descriptors: tuple[int, ...]) -> None:
        answers, their_answers = os.pipe()
        control = os.pidfd_open(os.getpid())
        places = ",".join(map(str, (their_answers, control, *numbers)))
        try:
            self._child = subprocess.Popen(
                [sys.executable, "-c", _BOOT, module, _ROOT, places, *import_path()],
                stdin=subprocess.PIPE,
                pass_fds=(their_answers, control, *descriptors),
                start_new_session=True,
            )
        finally:
            os.close(their_answers)
            os.close(control)
        self.pid = self._child.pid
        self._answers, self._received = answers, b""
        assert self._child.stdin is not None
        self._orders = self._child.stdin
        self._files = identity(self._orders.fileno()), identity(answers)

    @property
    def connected(self) -> bool:
        """Whether both pipes are open. Other code of this process may have closed or replaced their descriptors."""
        return self._may_answer and not self._orders.closed and identity(self._orders.fileno()) == self._files[0]

    @property
    def _may_answer(self):
        """Whether the pipe for answers is open."""
        return identity(self._answers) == self._files[1]

    def keep_to(self, processors: set[int]) -> None:
        """Restrict the child and its descendants to processors. Does nothing if it has ended or may not run there."""
        with suppress(OSError):
            for thread in self._threads():
                os.sched_setaffinity(thread, processors)

    def bring_to(self, processors: set[int]) -> None:
        """Move the child to processors without restricting it, so that a real-time thread can yield to another."""
        with suppress(OSError):
            for thread in self._threads():
                before = os.sched_getaffinity(thread)
                os.sched_setaffinity(thread, processors)
                os.sched_setaffinity(thread, before)

    def wait(self, timeout: float) -> None:
        """Wait until it has ended. subprocess.TimeoutExpired after `timeout` s"""
        try:
            ended = os.pidfd_open(self.pid)
            poll = select.poll()
            poll.register(ended, select.POLLIN)
            poll.poll(timeout * 1e3)
            os.close(ended)
        except OSError:  # no descriptor is left, or the process has been reaped
            self._child.wait(timeout)
        self._child.wait(0.0)

    def end(self, timeout: float = 0.0) -> None:
        """Close both pipes, and kill the process unless it ends within `timeout` s."""
        self._close_answers()
        with suppress(OSError):  # of an order that it has not read
            self._orders.close()
        with suppress(subprocess.TimeoutExpired):
            self.wait(timeout)
        self._child.kill()
        self._child.wait()

    def _close_answers(self) -> None:
        """Close the pipe for answers, unless its descriptor was closed or belongs to another file now."""
        if self._may_answer:
            os.close(self._answers)

    def _threads(self) -> Iterable[int]:
        return map(int, os.listdir(f"/proc/{self.pid}/task"))

    def _send(self, order: bytes, timeout: float | None = None) -> None:
        """Write bytes to the standard input of the child.

        timeout : s; None waits as long as the child does not read. Raises BrokenPipeError if it has ended, TimeoutError
        """
        pipe, left = self._orders.fileno(), memoryview(order)
        deadline = None if timeout is None else time.monotonic() + timeout
        writable = select.poll()
        writable.register(pipe, select.POLLOUT)
        os.set_blocking(pipe, False)
        while left:
            wait = None if deadline is None else max(0.0, deadline - time.monotonic()) * 1e3
            if not writable.poll(wait):
                raise TimeoutError
            left = left[os.write(pipe, left) :]

    def _answer(self, timeout: float) -> Any:
        """Return the next line of JSON; None if the child ended without one. Raises TimeoutError."""
        deadline = time.monotonic() + timeout
        poll = select.poll()
        poll.register(self._answers, select.POLLIN)
        while b"\n" not in self._received:
            if not poll.poll(max(0.0, deadline - time.monotonic()) * 1e3):
                raise TimeoutError
            data = os.read(self._answers, 1 << 16)
            if not data:
                return None
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        return json.loads(line)
