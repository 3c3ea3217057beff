"""Terminals for tests: a pseudo terminal with a run in its foreground, what it shows, and what is pressed."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time

from tests.runtime.runs import environment, module, write

WIDE = struct.pack("HHHH", 24, 160, 0, 0)

# A spring that pushes with -K: live parameters of a native block, with a slew of their own and with the default one,
# and of a Python block.
LIVE = '''
import math

from blocks.controllers import Impedance
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Live, Output, Param


class Wave(Block):
    """Nothing but its parameters."""

    angle = Param(0.5, "rad", "of the wave", min=-1.0, max=1.5, live=True, slew=math.inf)
    count = Param(3, "1", min=0, max=12, live=True)
    on = Param(True, "1", min=False, max=True, live=True)
    shape = Param(2.0, "1", "of the wave; not live")
    y = Output("1")

    def step(self):
        return self.angle + 10.0 * self.count + 1000.0 * self.on


with Diagram("springs", rate=200) as diagram:
    Impedance(stiffness=Live(30.0, max=150.0, slew=200.0), name="spring")(position=1.0, velocity=0.0)
    Wave(name="wave")
    CsvRecorder()
'''


def live_diagram(folder):
    return write(folder, LIVE, "springs.py")


def patient(look, timeout=20.0):
    """What `look` gives once it is true."""
    until = time.monotonic() + timeout
    while not (found := look()):
        assert time.monotonic() < until, "it does not come"
        time.sleep(0.01)
    return found


def own_it():
    fcntl.ioctl(2, termios.TIOCSCTTY, 0)


class Terminal:
    """A pseudo terminal. `start` begins a process in a session that it controls, in its foreground."""

    def __init__(self):
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, WIDE)
        self.before = self.attributes
        self.shown = b""
        self.process = None

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        if self.process is not None and self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        os.close(self.master)
        os.close(self.slave)

    def start(self, *words, cwd, **how):
        """Start a Python."""
        how = {**self.session, "preexec_fn": own_it, **how}
        self.process = subprocess.Popen([sys.executable, *map(str, words)], cwd=cwd, **how)
        return self

    def run(self, *words, cwd, **how):
        """Start a command of Tickwork."""
        self.process = module("runtime", *words, cwd=cwd, **{**self.session, **how})
        return self

    @property
    def session(self):
        files = {"stdin": self.slave, "stdout": self.slave, "stderr": self.slave}
        return {**files, "env": environment(TERM="xterm"), "start_new_session": True}

    @property
    def attributes(self):
        return termios.tcgetattr(self.slave)

    @property
    def takes_keys(self):
        return not self.attributes[3] & termios.ICANON

    def press(self, keys):
        """Press keys. What is then waited for has come after that."""
        self.look()
        self.shown = b""
        os.write(self.master, keys)

    def answer(self, key, then):
        """Press a key that answers a question until it counts: one that may be from before the question does not, nor
        does one while a busy machine holds up the reply of a drive.

        then : pattern that is shown afterwards
        """
        refused = "press it again" if "not armed again" in then else "press it again|not armed again"
        self.press(key)
        while self.wait_for(f"{refused}|{then}")[0] in refused.split("|"):
            self.press(key)

    def words(self):
        """What the terminal shows, each run of spaces and line ends as one space: reports are wrapped at its width."""
        return " ".join(self.look().split())

    def look(self):
        """All that has been shown since keys were last pressed."""
        while select.select([self.master], [], [], 0)[0]:
            self.shown += os.read(self.master, 1 << 16)
        return re.sub(r"\x1b\[[0-9;]*m", "", self.shown.decode(errors="replace"))

    def wait_for(self, pattern, timeout=20.0):
        """The match of a pattern in what has been shown since keys were last pressed."""
        try:
            return patient(lambda: re.search(pattern, self.look()), timeout)
        except AssertionError:
            raise AssertionError(f"no {pattern!r} in {self.look()[-2000:]}") from None

    def end(self, timeout=20.0):
        """Wait for the process. Returns its exit code."""
        patient(lambda: self.look() is not None and self.process.poll() is not None, timeout)
        return self.process.returncode
