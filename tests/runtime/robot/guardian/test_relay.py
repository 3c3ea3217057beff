"""The relay of a charge pump, behind a microcontroller's line: what goes over it before and after real processes are
killed. Drives on udp_multicast.
"""

import binascii
import os
import select
import signal
import threading
import time
import tty

import pytest

from blocks.charge_pump import ChargePump
from runtime.robot.emulation.priority import priority_of_loop, take_priority
from runtime.robot.guardian.relay import Relay
from tests.blocks.test_charge_pump import message
from tests.runtime.robot.guardian.bus import Bus, guardian_of
from tests.runtime.runs import DISABLE
from tests.runtime.terminals import patient
from tests.soaking import soaked

pytestmark = pytest.mark.paced

LATE = 0.08  # s, on a machine that may be busy; a period is 5 ms
HOLD = 0.3  # s


class Microcontroller:
    """The other end of the line: when each good message with another number came (s, time.time())."""

    def __init__(self, folder):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.port = os.ttyname(self.slave)
        self.times, self.bad, self.over = [], 0, threading.Event()
        self.thread = threading.Thread(target=self.listen)
        self.thread.start()

    def listen(self):
        take_priority()
        heard, newest = b"", None
        while not self.over.is_set():
            if not select.select([self.master], [], [], 0.05)[0]:
                continue
            heard += os.read(self.master, 4096)
            now = time.time()
            *parts, heard = heard.split(b"\0")
            for part in parts:
                number = next((number for number in range(256) if message(number) == part + b"\0"), None)
                self.bad += number is None
                if number is not None and number != newest:
                    self.times.append(now)
                    newest = number

    def after(self, instant):
        return [when - instant for when in self.times if when > instant]

    def unplug(self):
        self.over.set()
        self.thread.join()
        if self.master >= 0:
            os.close(self.master)
        self.master = -1

    def close(self):
        self.unplug()
        os.close(self.slave)


@pytest.fixture
def lab(tmp_path):
    """A bus, and a microcontroller whose relay holds the power of what is on it."""
    with Bus(tmp_path, number=11) as bus:
        board = Microcontroller(tmp_path)
        bus.rig.write_text(bus.rig.read_text() + f'\n[device.pump]\nport = "{board.port}"\n')
        yield bus, board
        for run in bus.runs:
            if run.poll() is None:
                run.kill()
                run.communicate()
        board.close()


def running(lab, **how):
    """A run under torque, with a pump that toggles."""
    bus, board = lab
    process = bus.start(
        "--no-record",
        blocks="from blocks.charge_pump import ChargePump",
        more=f'ChargePump(name="pump", hold={HOLD}, start_up=0.05)',
        **how,
    )
    bus.await_torque()
    since = time.time()
    bus.listen(0.3)
    patient(lambda: len(board.after(since)) >= 25)
    assert board.bad == 0
    return process


def listen(bus, *seconds_and_what):
    """What `bus.listen` returns. Both threads have priority: one that holds the interpreter would delay the other."""
    with priority_of_loop():
        return bus.listen(*seconds_and_what)


@pytest.mark.hazard("H8g")
def test_after_kill_9_of_both_processes_only_the_relay_stops_the_drives(lab):
    bus, board = lab
    process = running(lab)
    guardian = guardian_of(process)
    killed = time.time()
    os.kill(guardian.pid, signal.SIGSTOP)  # in the same instant, for both
    process.kill(), guardian.kill()
    listen(bus, 0.4)
    process.communicate(timeout=10)
    later = {frame.data for frame in bus.frames if frame.time > killed}
    assert DISABLE not in later  # the drives keep their last command
    assert not [when for when in board.after(killed) if when > LATE]


def test_the_guardian_holds_the_relay_while_it_damps_and_no_longer(lab):
    bus, board = lab
    process = running(lab, drive=', safe_stop="damp", stop_time=0.5')
    killed = time.time()
    process.kill()
    listen(bus, 1.0)
    process.communicate(timeout=10)
    pulses = [0.0, *board.after(killed)]
    assert bus.stopped_after(killed) == pytest.approx(0.5, abs=LATE)
    assert (
        pulses[-1] == pytest.approx(0.5, abs=LATE)
        and max(after - before for before, after in zip(pulses, pulses[1:])) < LATE
    )


@pytest.mark.soak
def test_a_continued_run_does_not_close_the_relay(lab):
    bus, board = lab
    process = running(lab, drive=', safe_stop="damp", stop_time=0.2')
    os.kill(process.pid, signal.SIGSTOP)
    bus.listen(0.2 + HOLD + LATE)
    dropped = time.time()
    os.kill(process.pid, signal.SIGCONT)
    listen(bus, 0.5)
    _, err = process.communicate(timeout=10)
    assert process.returncode == 3 and "fenced by the guardian" in err and board.after(dropped) == []


@pytest.mark.parametrize("how", soaked([signal.SIGTERM, signal.SIGKILL, "a block that hangs"], but=[1]))
def test_no_pulse_follows_the_first_frame_that_disables(lab, how):
    bus, board = lab
    process = running(lab, law="while tick > 200: pass" if how == "a block that hangs" else "pass")
    if how != "a block that hangs":
        process.send_signal(how)
    assert listen(bus, 5.0, lambda frame: frame.data == DISABLE)
    stopped = time.time()
    listen(bus, 0.3)
    process.communicate(timeout=10)
    assert not [when for when in board.after(stopped) if when > LATE]


def test_unplugged_microcontroller_ends_run_with_message(lab):
    bus, board = lab
    process = running(lab)
    board.unplug()
    unplugged = time.time()
    _, err = process.communicate(timeout=10)
    bus.listen()
    assert (
        process.returncode == 3
        and "FAULT at pump, tick " in err
        and "its line is disconnected, so the relay opens" in err
    ), err
    assert bus.stopped_after(unplugged) < LATE


# The guardian's part alone


def test_the_frames_of_the_guardian_are_two_that_alternate():
    assert ChargePump(name="pump").relay_frames() == [b"\0", b"\1"]
    assert ChargePump(name="pump", port="/dev/ttyACM0").relay_frames() == [message(0), message(1)]
    assert binascii.crc_hqx(b"\1", 0xFFFF) == 0xF1D1


def test_lost_relay_line_raises_no_exception(monkeypatch):
    out, into = os.pipe()
    relay = Relay({"descriptor": into, "gpio": False, "frames": [b"a".hex(), b"b".hex()], "hold": 0.1}, 1_000_000_000)
    times = iter((1_010_000_000, 1_100_000_000, 1_190_000_000, 1_290_000_000, 1_200_000_000, 1_200_000_000))
    monkeypatch.setattr("runtime.robot.guardian.relay.monotonic_ns", lambda: next(times))
    for _ in range(3):
        relay.change()
    assert os.read(out, 64) == b"aba"
    relay.change()
    os.close(out)
    relay.change()
    os.close(into)
    relay.change()
    with pytest.raises(OSError):
        os.read(out, 1)


@pytest.mark.parametrize("gpio", [False, True])
def test_a_line_that_a_block_has_closed_prevents_no_stop(gpio):
    closed, other = os.pipe()
    os.close(closed)
    os.close(other)
    relay = Relay({"descriptor": other, "gpio": gpio, "frames": ["01", "00"], "hold": 0.1}, time.monotonic_ns())
    relay.change()
    assert relay.sent == 0
