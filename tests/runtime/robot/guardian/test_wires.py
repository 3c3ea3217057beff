"""Interfaces as the guardian has them: real sockets of udp_multicast, and python-can's in-memory bus."""

import errno
import itertools
import math
import os
import resource
import select
import socket
import time
from types import SimpleNamespace

import can
import pytest

from runtime.robot.emulation.priority import priority_of_loop
from runtime.robot.guardian import wires
from runtime.robot.guardian.wires import (
    ECHO_LIMIT,
    ECHO_TIMEOUT,
    CannotOpen,
    PythonCanWire,
    SocketCanWire,
    Stamped,
    keep_apart,
)
from tests.runtime.robot.guardian.drives import open_bus

pytestmark = pytest.mark.timing

PORT = 43113  # of udp_multicast
CHANNELS = (f"239.{210 + os.getpid() % 40}.{os.getpid() // 40 % 250}.{number}" for number in itertools.count(1))
NOTHING = bytes.fromhex("7fff7ff0000007ff")


@pytest.fixture
def channel():
    return next(CHANNELS)


@pytest.fixture
def wire(channel):
    wire = PythonCanWire("udp_multicast", channel, 1_000_000, False)
    yield wire
    wire.close()


@pytest.fixture
def node(channel):
    node = open_bus(channel)
    yield node
    node.shutdown()


def heard(wire, count):
    """The next frames, as they come."""
    frames = []
    while len(frames) < count and select.select([wire], [], [], 5.0)[0]:
        frames += received(wire)
    return frames


def received(wire):
    """The frames that have come, without their arrivals."""
    return [frame[:2] for frame in wire.receive()]


def message(identifier, data, extended=False, **kind):
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended, **kind)


def test_echoes_of_sent_frames_are_not_received(wire, node):
    assert all(wire.send(127, NOTHING) for _ in range(3))
    node.send(message(127, bytes.fromhex("7f8000800800460" + "0")))
    assert heard(wire, 1) == [(127, bytes.fromhex("7f80008008004600"))]
    assert wire.counts == {"echoes": 3}


@pytest.mark.parametrize("interface", ["udp_multicast", "virtual"])
def test_frames_over_eight_bytes_switch_the_rate_of_a_bus_with_a_data_bitrate(interface, channel):
    """The other node is python-can's own; flags 5 are FD with BRS, 4 is FD without."""
    with can.Bus(interface=interface, channel=channel, fd=True) as node:
        wire = PythonCanWire(interface, channel, 1_000_000, True, None, 5_000_000)
        for data in (bytes(range(64)), b"short"):
            assert wire.send(5, data)
        long, short = node.recv(5.0), node.recv(5.0)
        assert (long.is_fd, long.bitrate_switch, bytes(long.data)) == (True, True, bytes(range(64)))
        assert (short.is_fd, short.bitrate_switch, bytes(short.data)) == (False, False, b"short")
        node.send(message(6, bytes(48), is_fd=True, bitrate_switch=True))
        node.send(message(7, bytes(4), is_fd=True))
        frames = []
        while len(frames) < 2:
            frames += wire.receive()
        wire.close()
    assert [(identifier, len(data), flags) for identifier, data, _, flags in frames] == [(6, 48, 5), (7, 4, 4)]


def test_a_foreign_frame_equal_to_an_own_one_is_received_beside_the_echo(wire, node):
    wire.send(127, NOTHING)
    node.send(message(127, NOTHING))
    assert heard(wire, 1) == [(127, NOTHING)] and wire.counts == {"echoes": 1}


def test_frames_in_excess_of_sent_ones_are_foreign(wire, node):
    for _ in range(40):  # as a steady torque is sent, again and again
        wire.send(127, NOTHING)
    for _ in range(3):
        node.send(message(127, NOTHING))
    assert heard(wire, 3) == [(127, NOTHING)] * 3 and wire.counts == {"echoes": 40}


def test_only_recent_frames_are_stored_for_echo_detection(channel):
    wire = PythonCanWire("virtual", channel, 1_000_000, False)
    for number in range(ECHO_LIMIT):
        assert wire.send(number, b"early")
    assert wire.is_echo((7, b"early")) and len(wire.echoes) == ECHO_LIMIT
    time.sleep(ECHO_TIMEOUT)
    assert wire.send(1, b"late") and list(wire.echoes) == [(1, b"late")]
    wire.close()


def test_lost_echo_hides_foreign_frame_only_temporarily(channel):
    """This interface returns no echo, and the same frame is sent repeatedly."""
    wire, node = PythonCanWire("virtual", channel, 1_000_000, False), can.Bus(channel, interface="virtual")
    end = time.monotonic() + 2.0 * ECHO_TIMEOUT
    while time.monotonic() < end:
        wire.send(127, NOTHING)
        sent = wire.echoes[127, NOTHING]
        time.sleep(0.002)
    assert 0 < len(sent) <= 0.6 * 2.0 * ECHO_TIMEOUT / 0.002 and sent[-1] - sent[0] < ECHO_TIMEOUT
    time.sleep(ECHO_TIMEOUT)
    node.send(message(127, NOTHING))
    assert received(wire) == [(127, NOTHING)] and wire.counts == {}
    wire.close()
    node.shutdown()


def test_frames_of_every_kind_pass_both_ways(wire, node):
    wire.send(0x80012345, b"abc")
    wire.send(0x40000123, b"")
    one, other = node.recv(1.0), node.recv(1.0)
    assert (one.arbitration_id, one.is_extended_id, one.data, other.is_remote_frame) == (0x12345, True, b"abc", True)
    node.send(message(0x54321, b"xyz", extended=True))
    node.send(message(0x1, b"", is_remote_frame=True))
    node.send(message(0x4, bytes(8), is_error_frame=True))
    assert heard(wire, 3) == [(0x80054321, b"xyz"), (0x40000001, b""), (0x20000004, bytes(8))]
    assert wire.counts["errors"] == 1


def test_invalid_frame_is_counted_and_reception_continues(wire, node, channel):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for rubbish in (b"", b"\xc1", b"rubbish", os.urandom(300), b"\x93\x01\x02\x03"):
            stranger.sendto(rubbish, (channel, PORT))
    node.send(message(1, b"after"))
    assert heard(wire, 1) == [(1, b"after")]
    assert wire.counts["corrupt"] == 5 and wire.trouble is None


def test_multicast_frames_stay_on_this_machine(wire):
    with socket.socket(fileno=os.dup(wire.bus.fileno())) as twin:
        assert twin.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0


def test_two_buses_of_one_machine_are_isolated(wire, node):
    other = open_bus(next(CHANNELS))
    other.send(message(1, b"other"))
    node.send(message(1, b"ours"))
    assert heard(wire, 1) == [(1, b"ours")]
    other.shutdown()


def test_frames_received_before_filtering_are_discarded(channel):
    other = next(CHANNELS)
    with open_bus(other) as node:  # somebody of this machine is in that group
        bus = can.Bus(channel, interface="udp_multicast")
        with open_bus(other) as talker:
            talker.send(message(127, NOTHING))
        assert select.select([bus], [], [], 5.0)[0] and node.recv(5.0) is not None
        keep_apart(bus.fileno())
        assert bus.recv(0.05) is None
        bus.shutdown()


def test_interface_that_python_can_cannot_open_reports_reason():
    with pytest.raises(CannotOpen, match="could not create or configure socket"):
        PythonCanWire("udp_multicast", "192.0.2.1", 1_000_000, False)


def test_an_interface_for_which_descriptors_lack_cannot_be_opened_and_leaves_none_open(channel):
    """A stop that opens a lost interface again goes on then."""
    wire = PythonCanWire("udp_multicast", channel, 1_000_000, False)
    wire.close()
    free, limits, opened = os.dup(0), resource.getrlimit(resource.RLIMIT_NOFILE), []
    os.close(free)
    for descriptors in range(4):
        before = os.listdir("/proc/self/fd")
        resource.setrlimit(resource.RLIMIT_NOFILE, (free + descriptors, limits[1]))
        try:
            wire = PythonCanWire("udp_multicast", channel, 1_000_000, False)
        except CannotOpen:
            opened.append(False)
        else:
            opened.append(True)
            wire.close()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        assert os.listdir("/proc/self/fd") == before
    assert opened == sorted(opened) and not opened[1] and opened[-1]


def test_an_interface_without_a_descriptor_is_polled(channel):
    wire, node = PythonCanWire("virtual", channel, 1_000_000, False), can.Bus(channel, interface="virtual")
    node.send(message(3, b"abc"))
    assert wire.fileno() is None and received(wire) == [(3, b"abc")] and wire.receive() == []
    assert wire.send(3, b"def") and node.recv(1.0).data == b"def"
    wire.close()
    node.shutdown()


def test_failing_interface_is_reported_after_limit_and_never_raises(channel):
    wire = PythonCanWire("udp_multicast", channel, 1_000_000, False)
    with socket.socket(fileno=os.dup(wire.fileno())) as twin:
        wire.close()
        assert not any(wire.send(1, b"") for _ in range(99)) and wire.trouble is None
        assert not wire.send(1, b"") and wire.trouble[0] in (errno.EBADF, errno.EIO)
        assert wire.counts["refused"] == 100 and wire.receive() == []
        assert twin.fileno() >= 0


def test_missing_socketcan_interface_is_reported():
    with pytest.raises(CannotOpen, match="can_no_such"):
        SocketCanWire("can_no_such", False, False)


# Arrivals

TOLERANCE = 2_000_000  # ns between the clock of the test and a time stamp


def wall_offset():
    """Return how far the system clock, which may be set, is ahead of the clock of the test, in ns."""
    return time.time_ns() - time.monotonic_ns()


def sent_apart(node, stall=0.05, gap=0.01, count=3):
    """Send frames `gap` s apart while the wire is not read for `stall` s.

    Returns (the ns at which it was sent, wall_offset) of each.
    """
    times = []
    for number in range(count):
        times.append((time.monotonic_ns(), wall_offset()))
        node.send(message(number, b"x"))
        time.sleep(gap)
    time.sleep(stall)
    return times


def assert_arrivals(wire, times, tolerance=TOLERANCE):
    with priority_of_loop():  # a process that is held up between two clocks dates a frame as older than it is
        frames = wire.receive()
    assert [frame[0] for frame in frames] == list(range(len(times)))
    offset = wall_offset()
    delays = [(frame[2] - at, min(0, then - offset)) for frame, (at, then) in zip(frames, times)]
    assert all(earliest <= delay < tolerance for delay, earliest in delays), delays


def test_queued_frames_keep_their_arrival_times(wire, node):
    assert wire.receive() == []
    times = sent_apart(node)
    assert_arrivals(wire, times)


def test_an_interface_without_a_descriptor_keeps_the_time_at_which_each_frame_arrived(channel):
    wire, node = PythonCanWire("virtual", channel, 1_000_000, False), can.Bus(channel, interface="virtual")
    times = sent_apart(node)
    assert_arrivals(wire, times)
    wire.close()
    node.shutdown()


def test_a_thread_that_receives_notes_when_each_frame_arrived(channel, monkeypatch):
    monkeypatch.setattr(wires, "NEVER_WAITS", set())
    wire = PythonCanWire("virtual", channel, 1_000_000, False)
    monkeypatch.setattr(wire.bus, "_recv_internal", without_stamps(wire.bus._recv_internal))
    with can.Bus(channel, interface="virtual") as node:
        times = sent_apart(node)
    assert_arrivals(wire, times, 40_000_000)  # ns; the thread waits for a processor, and the reader for 50 ms
    wire.close()


def without_stamps(receive):
    def stripped(timeout):
        message, filtered = receive(timeout)
        if message is not None:
            message.timestamp = 0.0
        return message, filtered

    return stripped


@pytest.mark.parametrize("stamp", [0.0, 12.5, 4e9, math.nan, math.inf, -1.0, 1e300])
def test_a_time_stamp_of_another_clock_is_replaced_by_the_time_at_which_the_frame_is_read(stamp):
    bus = Stamped(SimpleNamespace(fileno=None, recv=lambda timeout: SimpleNamespace(timestamp=stamp)))
    before = time.monotonic_ns()
    _, arrival = bus.recv(0)
    assert before <= arrival <= time.monotonic_ns()


def test_arrival_times_never_precede_the_previous_frame_or_an_empty_read():
    """So a time stamp that is wrong makes a device silent too early at worst, and never too late."""
    queue = []
    bus = Stamped(SimpleNamespace(fileno=None, recv=lambda timeout: queue.pop(0) if queue else None))
    time.sleep(0.02)
    queue += [SimpleNamespace(timestamp=time.time() - back) for back in (0.005, 0.010)]
    first, second = bus.recv(0)[1], bus.recv(0)[1]
    assert first == second and time.monotonic_ns() - first == pytest.approx(5e6, abs=TOLERANCE)
    empty = time.monotonic_ns()
    assert bus.recv(0) == (None, None)
    queue.append(SimpleNamespace(timestamp=time.time() - 0.005))
    assert empty <= bus.recv(0)[1] < empty + TOLERANCE


@pytest.mark.parametrize("step", [-0.005, 0.005])
def test_queued_messages_keep_their_distances_when_the_system_clock_is_set(step):
    bus = Stamped(SimpleNamespace(fileno=None, recv=lambda timeout: queue.pop(0)))
    bus.earliest -= 50_000_000  # as if it were empty 50 ms ago
    stamps = [time.time() + step - back for back in (0.03, 0.02, 0.01)]
    queue = [SimpleNamespace(timestamp=stamp) for stamp in stamps]
    arrivals = [bus.recv(0)[1] for _ in stamps]
    assert [later - earlier for earlier, later in zip(arrivals, arrivals[1:])] == pytest.approx(
        [10e6, 10e6], abs=TOLERANCE
    )
