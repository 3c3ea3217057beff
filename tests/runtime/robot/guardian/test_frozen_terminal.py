"""A terminal, or a program that reads the messages, which takes no more of them, delays no stop."""

import os
import pty
import termios
import time
from contextlib import suppress

import psutil
import pytest

from tests.runtime.robot.guardian.bus import Bus, guardian_of
from tests.runtime.robot.guardian.test_handover import WAYS, Drives
from tests.runtime.runs import DISABLE, NOTHING
from tests.soaking import soaked

pytestmark = pytest.mark.paced


class ClosedPipe:
    """Standard error as a pipe whose reader ends, as `head` and a dropped connection do."""

    def __init__(self):
        self.ours, self.theirs = os.pipe()

    def freeze(self):
        os.close(self.ours)

    def close(self):
        os.close(self.theirs)


class FullPipe(ClosedPipe):
    """A pipe that its reader does not empty any more."""

    def freeze(self):
        filler = os.open(f"/proc/self/fd/{self.theirs}", os.O_WRONLY | os.O_NONBLOCK)
        with suppress(BlockingIOError):
            while True:
                os.write(filler, b"x" * 4096)
        with suppress(BlockingIOError):
            while True:
                os.write(filler, b"x")
        os.close(filler)

    def close(self):
        os.close(self.ours)
        os.close(self.theirs)


class StoppedTerminal(FullPipe):
    """A terminal whose output is stopped, as with Ctrl-S."""

    def __init__(self):
        self.ours, self.theirs = pty.openpty()

    def freeze(self):
        termios.tcflow(self.theirs, termios.TCOOFF)


class ClosedTerminal(ClosedPipe):
    """A terminal that was closed."""

    def __init__(self):
        self.ours, self.theirs = pty.openpty()


KINDS = (ClosedPipe, FullPipe, StoppedTerminal, ClosedTerminal)
PAIRS = [(WAYS[place % 3], KINDS[place % 4]) for place in range(12)]


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("way, kind", soaked(PAIRS, but=[0]))
def test_a_stop_continues_if_nothing_accepts_its_messages(way, kind, tmp_path):
    messages = kind()
    with Bus(tmp_path, number=22, answering=False) as bus, Drives(bus) as drives:
        process = bus.start("--no-record", "--stop-for", "60", stderr=messages.theirs, start_new_session=True)
        bus.await_torque()
        drives.awake = False
        guardian = guardian_of(process)
        messages.freeze()
        if way != "the run waits":
            (guardian if way == "the guardian was killed" else process).kill()
        bus.listen(2.0)
        late = time.time() - 0.7
        for motor in bus.motors:
            assert {frame.data for frame in bus.commands(motor, late, asking=True)} == {NOTHING, DISABLE}
        drives.awake = True
        bus.listen(1.0)
        late = time.time() - 0.3
        assert not any(bus.commands(motor, late, asking=True) for motor in bus.motors), "it was confirmed"
        for each in (process, guardian):  # they may wait for the terminal
            with suppress(ProcessLookupError, psutil.NoSuchProcess):
                each.kill()
    messages.close()
