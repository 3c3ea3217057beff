"""A new run takes its buses over from a safe stop that goes on: at the first start, and without a pause in which the
drives get no frame.
"""

import math
import os
import re
import select
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace

import can
import pytest

from cext.memory.shared_state import SharedState
from cext.safety.thresholds import STOP_ROUND_MAXIMUM
from runtime.host.errors import FAULT, OK
from runtime.robot.emulation.priority import take_priority
from runtime.robot.guardian.handover import Handover, Offer, Successor
from runtime.robot.guardian.interfaces import Interfaces
from runtime.robot.guardian.lock import BusLock, BusTaken
from tests.blocks.actuators import reference
from tests.checkout import ROOT
from tests.runtime.robot.guardian.bus import Bus, guardian_of, is_torque
from tests.runtime.robot.guardian.drives import AK10_9, open_bus
from tests.runtime.robot.guardian.test_carrying import Carrying
from tests.runtime.robot.rig.test_slcan import Adapter, awaited, rig_of
from tests.runtime.runs import DISABLE, NOTHING, knee, started
from tests.soaking import soaked

pytestmark = pytest.mark.paced

PAUSE = 0.45  # s, longest without a frame to a drive: twice the period of the frames, and what a busy machine adds
WAKES = 100  # per s, most of a process whose stop goes on
GOES_ON = "continue at a falling rate"
WAYS = ("the run was killed", "the run waits", "the guardian was killed")


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to start a process of another account")
def test_the_process_of_a_stop_offers_its_bus_to_its_own_account_alone():
    with offered("account") as (offers, names):
        [name] = names
        for user, taken in ((0, "taken"), (65534, "refused")):
            script = (
                f"import os\nfrom runtime.robot.guardian.handover import Offer\nos.setuid({user})\n"
                f"try: Offer({name!r}); print('taken')\nexcept ConnectionRefusedError: print('refused')"
            )
            with subprocess.Popen(
                [sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE, text=True
            ) as process:
                while process.poll() is None:
                    offers(0.01)
                assert process.stdout.read() == f"{taken}\n", user


@pytest.mark.parametrize("bus", [0, None], ids=["CAN", "another bus"])
def test_a_bus_that_a_new_run_has_taken_is_offered_to_no_third(bus):
    with offered("first", "second", bus=bus) as (offers, names), ThreadPoolExecutor() as pool:

        def offer(name):
            found = pool.submit(Offer, name)
            while not found.done():
                offers(0.01)
            return found.result()

        second = [offer(name).accept()[1] for name in names]
        with pytest.raises(ConnectionRefusedError):
            offer(names[0])  # while it is handed over
        for link in second:
            link.send(b"a")
            offers(0.1)
        offers(1.1 * STOP_ROUND_MAXIMUM * 1e-9)
        for name in names:
            with pytest.raises(ConnectionRefusedError):
                offer(name)


def test_a_new_run_hands_all_of_its_locks_over_at_its_arming():
    """Locks of other buses than CAN have no index, all of them."""

    class State(SharedState):
        beat = 0

    guardian = Carrying(State(1 << 12)).guardian
    ends = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(3)]
    guardian.successors = [
        (bus, Successor(ours.detach())) for bus, (ours, _) in zip((0, None, None), ends, strict=True)
    ]
    guardian._attend(0)
    assert ends[0][1].recv(1) == b"s"  # frames were sent
    for _, theirs in ends:
        with pytest.raises(BlockingIOError):
            theirs.recv(1, socket.MSG_DONTWAIT)
    State.beat = 1
    guardian._attend(1)
    assert [theirs.recv(1) for _, theirs in ends] == [b"a"] * 3


@contextmanager
def offered(*words, bus=None):
    """Buses that are offered. Yields (function that attends to them for some seconds, names of their locks)."""
    names = [f"\0tickwork/bus/{word}-{os.getpid()}".encode() for word in words]
    stop = SimpleNamespace(waiting=[], stopped={}, lent=set(), given=set(), failing=set())
    interfaces = Interfaces([{"line": None}], [], select.poll())
    with ExitStack() as stack:
        locks = [stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)) for _ in names]
        for lock, name in zip(locks, names, strict=True):
            lock.bind(name)
        offers = Handover(
            [
                {"name": name.decode(), "bus": bus, "descriptor": lock.fileno(), "handover": -1}
                for lock, name in zip(locks, names, strict=True)
            ],
            interfaces,
        )

        def attend(seconds):
            deadline = time.monotonic() + seconds
            while (left := deadline - time.monotonic()) > 0:
                offers.attend(time.monotonic_ns(), stop)
                for descriptor in interfaces.wait(math.ceil(1e3 * left), None):
                    offers.handle(descriptor, stop)

        attend(0.001)
        stack.callback(offers.close)
        yield attend, names


def wakes_of(process):
    """How often the threads of a process have waited so far. process : its id"""
    threads = Path(f"/proc/{process}/task").iterdir()
    status = "".join((thread / "status").read_text() for thread in threads)
    return sum(map(int, re.findall(r"^voluntary_ctxt_switches:\s+(\d+)", status, re.MULTILINE)))


class Drives:
    """Drives of a Bus in a thread, which answer while `awake`."""

    def __init__(self, bus):
        self.node, self.motors, self.sent, self.awake = open_bus(bus.channel), bus.motors, Counter(), True
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._play)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.ended.set()
        self.thread.join()
        self.node.shutdown()

    def _play(self):
        take_priority()
        while not self.ended.is_set():
            heard = self.node.recv(0.05)
            if heard is None:
                continue
            frame = heard.arbitration_id, bytes(heard.data)
            if self.sent[frame]:
                self.sent[frame] -= 1
            elif self.awake and frame[0] in self.motors and len(frame[1]) == 8:
                answer = bytes(reference.held_reply(AK10_9, frame[0], 0.1, frame[1], 30.0, 0))
                self.sent[frame[0], answer] += 1
                self.node.send(can.Message(arbitration_id=frame[0], is_extended_id=False, data=answer))


class TimedAdapter(Adapter):
    """Adapter that keeps the times of its frames, in s."""

    times = ()

    def answer(self, command):
        if command.startswith("t"):
            self.times = [*self.times, time.monotonic()]
        return super().answer(command)


def line_of(process, text):
    """Read standard error of a process until a line contains a text."""
    line, seen = "", []
    while text not in line:
        line = process.stderr.readline()
        seen.append(line)
        assert line, f"it ended without {text!r}: {seen}"
    return line


@contextmanager
def stop_that_goes_on(folder, way):
    """A stop on a Bus whose drives do not answer, by the processes bus.waiting. Yields (bus, drives, process of the
    run).
    """
    with Bus(folder, number=21, answering=False) as bus, Drives(bus) as drives:
        process = bus.start("--no-record", "--stop-for", "60")
        bus.await_torque()
        drives.awake = False
        guardian = guardian_of(process)
        if way != "the run waits":
            (guardian if way == "the guardian was killed" else process).kill()
        bus.waiting = [process.pid] * (way != "the run was killed") + [guardian.pid] * (
            way != "the guardian was killed"
        )
        line_of(process, GOES_ON)
        bus.listen(0.7)  # until the frames are rare
        yield bus, drives, process


def longest_pause(frames, motor, since):
    """Longest time in s between two frames to a motor."""
    times = [frame.time for frame in frames if frame.identifier == motor and frame.is_command and frame.time >= since]
    return max(later - earlier for earlier, later in zip(times, times[1:]))


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("way", soaked(WAYS, but=[1]))
def test_a_new_run_takes_the_buses_over_at_once_and_without_a_pause(way, tmp_path):
    with stop_that_goes_on(tmp_path, way) as (bus, drives, process):
        began = time.time()
        second = bus.start("--no-record", "--duration", "0.5")
        said = line_of(process, "continues the stop of")
        assert re.search(rf"process {second.pid} continues the stop of left/knee, right/knee", said)
        drives.awake = True
        while second.poll() is None:
            bus.listen(0.05)
        process.communicate(timeout=10)
        _, errors = second.communicate(timeout=20)
        assert second.returncode in (OK, FAULT), errors  # a busy machine may end it
        for motor in bus.motors:
            assert longest_pause(bus.frames, motor, began) < PAUSE
        assert any(is_torque(frame) for frame in bus.frames if frame.time >= began), errors


@pytest.mark.soak
@pytest.mark.parametrize("way", soaked(WAYS, but=[1]))
def test_a_new_run_that_does_not_begin_leaves_the_stop_to_the_old_one(way, tmp_path):
    with stop_that_goes_on(tmp_path, way) as (bus, drives, process):
        began = time.time()
        lock = BusLock("udp_multicast", bus.channel, {1, 2})
        assert lock.handover is not None
        assert lock.handover.send(b"o") and lock.handover.recv(1) == b"c"
        bus.listen(0.5)
        assert not bus.commands(1, time.time() - 0.4, asking=True)  # it sends no more
        lock.close()
        drives.awake = True
        text = "".join(process.communicate(timeout=10))
        bus.listen(0.1)
        assert {frame.data for motor in bus.motors for frame in bus.commands(motor, began)} == {NOTHING, DISABLE}
        assert "left/knee" in text and "only after" in text, text


@pytest.mark.parametrize("way", soaked(WAYS, but=[2]))
@pytest.mark.soak
def test_a_stop_that_goes_on_waits_between_its_frames(way, tmp_path):
    with stop_that_goes_on(tmp_path, way) as (bus, drives, process):
        before, began = list(map(wakes_of, bus.waiting)), time.time()
        bus.listen(1.0)
        wakes = [after - earlier for after, earlier in zip(map(wakes_of, bus.waiting), before, strict=True)]
        assert wakes and max(wakes) < WAKES * (time.time() - began)
        drives.awake = True
        process.communicate(timeout=10)


@pytest.mark.soak
@pytest.mark.parametrize("way", soaked(WAYS, but=[0]))
def test_a_run_without_these_drives_and_another_program_are_refused_and_change_nothing(way, tmp_path):
    with stop_that_goes_on(tmp_path, way) as (bus, drives, process):
        for identifiers in (None, set(), {2, 3}):
            with pytest.raises(BusTaken, match="whose stop of left/knee, right/knee continues") as taken:
                BusLock("udp_multicast", bus.channel, identifiers)
            assert "a run whose diagram has these drives takes the bus over" in taken.value.remedy
        began = time.time()
        bus.listen(1.0)
        assert len(bus.commands(1, began)) >= 6
        drives.awake = True
        process.communicate(timeout=10)


@pytest.mark.parametrize("way", soaked(WAYS, but=[1]))
@pytest.mark.soak
def test_an_adapter_that_one_process_may_open_is_handed_over(way, tmp_path):
    with TimedAdapter() as adapter:
        robot, rig = knee(tmp_path, "return 2.0"), rig_of(tmp_path, adapter.channel)
        words = [robot, "--rig", rig, "--yes", "--no-record"]
        first = started(*words, "--stop-for", "60", cwd=tmp_path)
        assert awaited(adapter.torque), "no torque was commanded"
        adapter.drives = ()
        if way == "the guardian was killed":
            guardian_of(first).kill()
        elif way == "the run was killed":
            first.kill()
        line_of(first, GOES_ON)
        time.sleep(0.7)
        adapter.times = []
        adapter.frames.clear()
        second = started(*words, "--stop-for", "0.2", "--duration", "0.5", cwd=tmp_path)
        line_of(first, "continues the stop of knee")
        adapter.drives = (1,)
        first.communicate(timeout=10)
        _, errors = second.communicate(timeout=20)
        assert second.returncode in (OK, FAULT) and adapter.torque(), errors
        assert max(later - earlier for earlier, later in zip(adapter.times, adapter.times[1:])) < PAUSE
