"""What arrives at the interfaces of a plan, and whom it reaches: wires over sockets, with a buffer as slcan has."""

import errno
import select
import socket
import time
from contextlib import suppress

import pytest

from cext.ring.rings import Line, Lines
from runtime.robot.guardian.interfaces import Interfaces
from runtime.robot.guardian.wires import FRAMES_AT_ONCE, Wire


class SocketWire(Wire):
    """A wire whose frames are the bytes of a socket. It reads all of them, and keeps those that it does not return."""

    def __init__(self):
        super().__init__()
        self.socket, self.peer = socket.socketpair()
        self.socket.setblocking(False)
        self.kept = b""

    def fileno(self):
        return self.socket.fileno()

    def receive(self):
        with suppress(BlockingIOError):
            self.kept += self.socket.recv(1 << 16)
        frames, self.kept = self.kept[:FRAMES_AT_ONCE], self.kept[FRAMES_AT_ONCE:]
        return [(byte, b"", time.monotonic_ns(), 0) for byte in frames]

    def close(self):
        self.socket.close()
        self.peer.close()


class PolledWire(SocketWire):
    """The same without a descriptor to wait for."""

    polled = True

    def fileno(self):
        return None


class Stop:
    """A stop that keeps what it is given. began : ns"""

    def __init__(self, began=0):
        self.began, self.received = began, []

    def receive(self, bus, identifier, data, now, since):
        self.received.append((bus, identifier, now, since))


def interfaces_of(wire, line=None, lines=None):
    interfaces = Interfaces([{"name": "legs", "line": line}], [], select.poll(), lines)
    interfaces.add(0, wire)
    return interfaces


@pytest.mark.parametrize("many", [1, FRAMES_AT_ONCE, 5 * FRAMES_AT_ONCE])
@pytest.mark.parametrize("kind", [SocketWire, PolledWire])
def test_all_frames_are_read_although_no_event_follows_the_first(kind, many):
    wire, stop = kind(), Stop()
    interfaces = interfaces_of(wire)
    wire.peer.send(bytes(many))
    began = time.monotonic()
    for _ in range(2 + many // FRAMES_AT_ONCE):
        interfaces.wait(10_000 if not stop.received else 0, stop)
    assert len(stop.received) == many and not interfaces.unread
    assert time.monotonic() - began < 5.0
    interfaces.close_all()


def test_an_interface_without_a_descriptor_is_read_every_millisecond():
    wire = PolledWire()
    interfaces = interfaces_of(wire)
    began = time.monotonic()
    interfaces.wait(10_000, None)
    assert time.monotonic() - began < 5.0
    interfaces.close(0)
    began = time.monotonic()
    interfaces.wait(50, None)  # none is left
    assert time.monotonic() - began >= 0.049


@pytest.mark.parametrize("line", [None, 0])
def test_an_interface_that_has_hung_up_fails_once_and_is_awaited_no_more(line):
    wire, stop = SocketWire(), Stop()
    interfaces = interfaces_of(wire, line)
    wire.peer.send(b"last")
    wire.peer.close()
    assert interfaces.wait(1000, stop) == [] and len(stop.received) == 4
    assert wire.trouble == (errno.EIO, "the interface has hung up")
    wire.trouble = None
    interfaces.wait(20, stop)
    assert wire.trouble is None
    interfaces.close_all()


class RefusedWire(SocketWire):
    """A wire whose socket has an error, which ends with a receive, as that of an interface that is down."""

    def __init__(self):
        super().__init__()
        self.socket.close()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", 9))
        self.socket.send(b"a")
        self.socket.setblocking(False)

    def receive(self):
        with suppress(OSError):
            return super().receive()
        return []


@pytest.mark.parametrize("line, fails", [(None, False), (0, True)])
def test_an_error_of_a_socket_fails_the_interface_of_a_carried_bus_alone(line, fails):
    """A SocketCAN interface may be up again later."""
    wire = RefusedWire()
    interfaces = interfaces_of(wire, line)
    interfaces.wait(1000, None)
    assert (wire.trouble is not None) == fails
    interfaces.close_all()


def test_other_descriptors_with_an_event_are_returned():
    wire, stop = SocketWire(), Stop()
    interfaces = interfaces_of(wire)
    ours, theirs = socket.socketpair()
    interfaces.poll.register(ours, select.POLLIN)
    wire.peer.send(b"a")
    theirs.send(b"b")
    assert interfaces.wait(1000, stop) == [ours.fileno()] and len(stop.received) == 1
    interfaces.close_all()
    ours.close()
    theirs.close()


def test_frames_that_arrived_before_a_stop_do_not_belong_to_it():
    wire = SocketWire()
    interfaces = interfaces_of(wire)
    stop = Stop(began=time.monotonic_ns() + 10**12)
    wire.peer.send(b"ab")
    interfaces.wait(1000, stop)
    assert stop.received == []
    interfaces.close_all()


def test_frames_count_as_old_as_they_can_be():
    """As old as the last time that everything had been read, or as the stop."""
    wire, stop = SocketWire(), Stop(began=time.monotonic_ns())
    interfaces = interfaces_of(wire)
    wire.peer.send(b"a" * 2 * FRAMES_AT_ONCE)
    before = time.monotonic_ns()
    interfaces.wait(1000, stop)
    interfaces.wait(1000, stop)
    interfaces.wait(0, stop)
    assert {since for *_, since in stop.received} == {stop.began} and stop.began < before
    wire.peer.send(b"a")
    interfaces.wait(1000, stop)
    _, _, now, since = stop.received[-1]
    assert before < since < now
    interfaces.close_all()


@pytest.mark.parametrize("line, given", [(None, []), (0, [b"a"[0]])])
def test_the_loop_gets_the_frames_of_a_bus_that_it_does_not_drive(line, given):
    wire, lines, stop = SocketWire(), Lines(1), Stop()
    interfaces = interfaces_of(wire, line, lines)
    wire.peer.send(b"a")
    interfaces.wait(1000, stop)
    assert [frame[0] for frame in Line(lines, 0).end.receive()] == given and len(stop.received) == 1
    interfaces.close_all()
