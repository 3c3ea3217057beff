"""A robot's bus over real SocketCAN: filters, echoes, stamps, error frames, interfaces that go away, and a whole
run.
"""

import errno
import fcntl
import os
import pty
import resource
import select
import struct
import subprocess
import threading
import time
import tty
from pathlib import Path

import pytest

from cext.bus.socketcan import SocketCan
from cext.safety.thresholds import TX_QUEUE_FULL_LIMIT
from runtime.host.machine.probe import Machine
from runtime.robot.rig.buses import in_words
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.interface import Interface
from tests.hardware.vcan import ERROR, EXTENDED, REMOTE, Node, ip, needs_own_kernel, needs_vcan

pytestmark = needs_vcan
MIT = [(127, 0x7FF, False), (0, 0x7FF, False)]  # what a drive with id 127 is heard by
TIOCSETD, N_SLCAN = 0x5423, 17  # of Linux: the line discipline that makes a port a CAN interface
NOTHING = bytes.fromhex("7fff7ff0000007ff")  # its zero-torque command: the first byte is its id


class Opened:
    """An interface with a SocketCan over it, as RigBuses makes one. shared : None: as found out"""

    def __init__(self, channel="vcan0", listens=MIT, speaks=((127, False),), shared=None, fd=False):
        self.interface = Interface(RigBus("legs", "socketcan", channel, fd=fd), listens, speaks, Machine())
        self.can = SocketCan(
            self.interface.socket,
            fd=fd,
            shared=self.interface.virtual if shared is None else shared,
            queue_full_limit=TX_QUEUE_FULL_LIMIT,
        )
        self.can.begin(0)

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.interface.close()

    def heard(self):
        return [frame for _ in range(400) for frame in self.can.end.receive(1)]


@pytest.fixture
def spare():
    """An interface that a test may take down."""
    ip("add", "vcan9", "type", "vcan")
    ip("set", "vcan9", "up")
    yield "vcan9"
    if Path("/sys/class/net/vcan9").exists():
        ip("del", "vcan9")


def refused(channel, fd=False):
    with pytest.raises(Refused) as caught:
        Opened(channel, fd=fd)
    return caught.value.problem


# Starting


def test_a_missing_interface_is_reported_with_the_commands_that_create_it():
    trouble = refused("vcan7")
    assert trouble.code == "TW112" and trouble.hint.endswith(
        "sudo ip link add vcan7 type vcan && sudo ip link set vcan7 up"
    )
    trouble = refused("can0")
    assert trouble.code == "TW112" and trouble.hint == "did you mean 'vcan0'?"


def test_a_network_interface_without_can_is_reported():
    assert (refused("lo").code, refused("lo").message) == ("TW113", "[bus.legs] lo is not a CAN interface")


@needs_own_kernel
def test_an_interface_that_is_down_is_reported_with_the_command_that_brings_it_up(spare):
    ip("set", spare, "down")
    trouble = refused(spare)
    assert (trouble.code, trouble.hint) == ("TW114", "sudo ip link set vcan9 up")


@needs_own_kernel
def test_an_interface_without_can_fd_is_reported(spare):
    ip("set", spare, "down")
    ip("set", spare, "mtu", "16")
    ip("set", spare, "up")
    with Opened(spare) as bus:
        assert bus.interface.virtual and bus.interface.remarks == []
    trouble = refused(spare, fd=True)
    assert trouble.code == "TW117" and "sudo ip link set vcan9 mtu 72" in trouble.hint


def test_a_failed_socket_is_reported_with_the_systems_message():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (1, hard))
    try:
        trouble = refused("vcan0")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert (trouble.code, trouble.message) == ("TW119", "[bus.legs] vcan0: Too many open files")


@needs_own_kernel
def test_a_kernel_whose_can_module_is_missing_is_reported():
    subprocess.run(["rmmod", "can_raw"], check=True)
    try:
        trouble = refused("vcan0")
    finally:
        subprocess.run(["modprobe", "-d", "/run", "can-raw"], check=True)
    assert (
        trouble.code == "TW111"
        and trouble.message.endswith("Protocol not supported")
        and trouble.hint.startswith("sudo modprobe can_raw")
    )


# Frames


def test_own_frames_are_received_by_other_nodes_only():
    with Opened() as bus, Node() as node:
        assert bus.can.end.send(127, NOTHING)
        assert node.heard() == [(127, NOTHING)] and bus.heard() == []
        node.send(127, NOTHING)
        assert [frame[:3] for frame in bus.heard()] == [(127, False, NOTHING)]  # on a virtual bus that may be a drive


def test_frames_sent_by_this_machine_on_a_real_interface_are_echoes():
    with Opened(shared=False) as bus, Node() as guardian:
        guardian.send(127, NOTHING)
        bus.can.end.send(127, NOTHING)
        assert bus.heard() == [] and bus.can.counts["echoes"] == 1


def test_frames_for_other_nodes_are_filtered_and_counted_with_their_ids():
    with Opened() as bus, Node() as node:
        for number in range(300):
            node.send(0x300 + number % 2, b"babble")
        node.send(EXTENDED | 127, NOTHING)
        node.send(REMOTE | 127)
        node.send(0, NOTHING)
        bus.can.end.send(127, NOTHING)
        assert [frame[:2] for frame in bus.heard()] == [(0, False)]
        count, ids = bus.interface.strangers.counts()
        assert count == 302 and ids[:2] == ["300", "301"]


def test_a_device_without_acceptance_filters_receives_every_frame():
    with Opened(listens=None) as bus, Node() as node:
        node.send(0x555, b"x")
        node.send(EXTENDED | 0x18FF0080, b"y")
        assert [frame[:3] for frame in bus.heard()] == [(0x555, False, b"x"), (0x18FF0080, True, b"y")]
        assert bus.interface.strangers is None


def test_can_fd_is_off_unless_requested():
    with (
        Opened(listens=None) as classic,
        Opened(listens=None, fd=True) as flexible,
        Opened(listens=None, fd=True) as sender,
    ):
        sender.can.end.send(1, bytes(range(64)))
        sender.can.end.send(2, b"short")
        assert [frame[2] for frame in flexible.heard()] == [bytes(range(64)), b"short"]
        assert [frame[2] for frame in classic.heard()] == [b"short"] and classic.can.counts["corrupt"] == 0


@needs_own_kernel
def test_a_wall_clock_that_is_set_does_not_move_frames():
    with Opened() as bus, Node() as node:
        for hours in (1, -1):
            before = time.monotonic_ns()
            bus.can.begin(0)
            node.send(127, NOTHING)
            between = time.monotonic_ns()
            wall = time.clock_gettime(time.CLOCK_REALTIME)
            time.clock_settime(time.CLOCK_REALTIME, wall + 3600 * hours)
            try:
                [(*_, at)] = bus.heard()
            finally:
                time.clock_settime(time.CLOCK_REALTIME, wall)
            assert before <= at <= time.monotonic_ns()
            if hours < 0:
                assert at >= between  # stamped in the future: of now
        bus.can.begin(0)
        before = time.monotonic_ns()
        node.send(127, NOTHING)
        after = time.monotonic_ns()
        time.sleep(0.02)
        [(*_, at)] = bus.heard()
        assert before - 2e6 <= at <= after + 2e6  # ns; 20 ms before it was read


@pytest.fixture
def jammed():
    """An adapter of the kernel's slcan driver behind a pty that nobody reads, so that what goes out stays. Yields
    (interface, its reader).
    """
    master, port = pty.openpty()
    tty.setraw(port)
    before = set(os.listdir("/sys/class/net"))
    fcntl.ioctl(port, TIOCSETD, struct.pack("i", N_SLCAN))
    [name] = set(os.listdir("/sys/class/net")) - before
    ip("set", name, "type", "can", "bitrate", "1000000")
    os.set_blocking(master, False)

    def drain():
        while select.select([master], [], [], 0.0)[0]:
            os.read(master, 65536)

    def changed(*words):
        """The driver waits until what it tells the adapter has gone out."""
        done = threading.Event()

        def read():
            while not done.wait(0.01):
                drain()

        reader = threading.Thread(target=read)
        reader.start()
        try:
            ip("set", name, *words)
        finally:
            done.set()
            reader.join()

    changed("txqueuelen", "10", "up")
    yield name, drain
    changed("down")
    os.close(port)
    os.close(master)


@needs_own_kernel
def test_a_kernel_queue_that_stays_full_is_counted_and_then_reported(jammed):
    name, drain = jammed
    with Opened(name) as bus, Node(name) as other:
        sent = 0
        while bus.can.end.send(127, NOTHING) and sent < 100_000:
            sent += 1
        assert 10 <= sent < 100_000 and bus.can.counts["refused"] == 1 and bus.can.trouble is None
        with pytest.raises(OSError) as raised:
            other.send(127, NOTHING)
        assert raised.value.errno == errno.ENOBUFS  # that is what it was
        for _ in range(TX_QUEUE_FULL_LIMIT - 1):
            bus.can.end.receive(1)
            assert not bus.can.end.send(127, NOTHING) and bus.can.trouble is None
        bus.can.end.receive(1)
        assert bus.can.trouble == "full" and bus.can.counts["refused"] == TX_QUEUE_FULL_LIMIT
        why, cure = in_words(bus.can.trouble, bus.interface.bus, False)
        assert (
            why.startswith(
                f"the queue of {name} was full for {TX_QUEUE_FULL_LIMIT} ticks: no node acknowledges its frames"
            )
            and "txqueuelen" in cure
        )


@needs_own_kernel
def test_a_drained_kernel_queue_continues_to_send(jammed):
    name, drain = jammed
    with Opened(name) as bus:
        while bus.can.end.send(127, NOTHING):
            pass
        taken, deadline = 0, time.monotonic() + 5.0
        while taken < 20 and time.monotonic() < deadline:  # twice what the queue holds
            drain()
            time.sleep(0.002)
            bus.can.end.receive(1)
            taken += bus.can.end.send(127, NOTHING)
        assert taken == 20 and bus.can.trouble is None and bus.can.counts["refused"] >= 1


def test_error_frames_come_through_the_filter():
    with Opened() as bus, Node() as controller:
        controller.send(ERROR | 0x004, bytes([0, 0x20, 0, 0, 0, 0, 0, 0]))
        assert len(bus.heard()) == 1 and bus.can.state == "passive"
        controller.send(ERROR | 0x040, bytes(8))
        assert len(bus.can.end.receive(1)) == 1
        assert bus.can.trouble == "bus-off" and not bus.can.end.send(127, NOTHING) and bus.can.end.send(127, NOTHING)
        assert bus.interface.strangers.counts() == (0, [])


@needs_own_kernel
@pytest.mark.parametrize(
    "change, number, words",
    [
        (("set", "vcan9", "down"), errno.ENETDOWN, "vcan9 went down"),
        (("del", "vcan9"), errno.ENODEV, "vcan9 disappeared"),
    ],
)
def test_a_lost_interface_is_reported_as_a_failure(spare, change, number, words):
    with Opened(spare) as bus:
        assert bus.can.end.send(127, NOTHING)
        ip(*change)
        assert bus.heard() == [] and bus.can.trouble == number
        why, cure = in_words(bus.can.trouble, bus.interface.bus, True)
        assert why.startswith(words) and cure.endswith("sudo ip link set vcan9 up")
        assert not bus.can.end.send(127, NOTHING)
