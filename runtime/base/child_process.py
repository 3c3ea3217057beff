"""A process of our own beside the run: started with the parent's packages, its orders on standard input, its answers as
lines of JSON.
"""

import json
import os
import select
import subprocess
import sys
import time
from contextlib import suppress

_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

# The parent's packages, whatever the working folder holds; then the parent's path, for packages that are not ours.
_BOOT = """
import sys
from importlib import import_module
module, root, numbers, path = sys.argv[1], sys.argv[2], sys.argv[3].split(","), sys.argv[4:]
sys.path[:] = [root, *path]
import cext, runtime
sys.path[:] = path
import_module(module).main(*map(int, numbers))
"""


class ChildProcess:
    """Spawned at once, in a session of its own.

    module : its `main` is called with two file descriptors, of the pipe for answers and a pidfd of this process, and
        with `numbers`
    numbers : whole numbers
    descriptors : file descriptors that it inherits under their numbers

    pid : number of the process
    """

    def __init__(self, module, numbers, descriptors):
        answers, their_answers = os.pipe()
        control = os.pidfd_open(os.getpid())
        places = ",".join(map(str, (their_answers, control, *numbers)))
        path = [os.path.abspath(entry) for entry in sys.path]
        try:
            self._child = subprocess.Popen(
                [sys.executable, "-c", _BOOT, module, _ROOT, places, *path],
                stdin=subprocess.PIPE,
                pass_fds=(their_answers, control, *descriptors),
                start_new_session=True,
            )
        finally:
            os.close(their_answers)
            os.close(control)
        self.pid = self._child.pid
        self._answers, self._heard = answers, b""

    def keep_to(self, processors):
        """From now on it runs on these alone, with all that it starts. One that has ended, or may not, stays as it
        is.
        """
        with suppress(OSError):
            for thread in self._threads():
                os.sched_setaffinity(thread, processors)

    def bring_to(self, processors):
        """It goes on there, and may leave: a thread of real-time priority does where another one is in its way."""
        with suppress(OSError):
            for thread in self._threads():
                before = os.sched_getaffinity(thread)
                os.sched_setaffinity(thread, processors)
                os.sched_setaffinity(thread, before)

    def _threads(self):
        return map(int, os.listdir(f"/proc/{self.pid}/task"))

    def _answer(self, timeout):
        """The next line of JSON from the process; None if it ended without one. TimeoutError."""
        deadline = time.monotonic() + timeout
        poll = select.poll()
        poll.register(self._answers, select.POLLIN)
        while b"\n" not in self._heard:
            if not poll.poll(max(0.0, deadline - time.monotonic()) * 1e3):
                raise TimeoutError
            data = os.read(self._answers, 1 << 16)
            if not data:
                return None
            self._heard += data
        line, _, self._heard = self._heard.partition(b"\n")
        return json.loads(line)
