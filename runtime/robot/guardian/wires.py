"""Non-blocking interfaces of the guardian, which raise no exception once they are open."""

from __future__ import annotations

import errno
import logging
import os
import socket
import struct
import threading
import time
from collections import deque
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING

from cext.safety.thresholds import INTERFACE_FAILURE_LIMIT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    import can

    from runtime.robot.guardian.plan_types import EncodedReply, PlanBus


EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
RATE_SWITCH, ERROR_STATE, FD = 1, 2, 4  # flags of struct canfd_frame
IP_MULTICAST_ALL, IPV6_MULTICAST_ALL = 49, 29  # Linux constants that Python's socket lacks
FRAMES_AT_ONCE = 64  # limit of frames in one `receive`
ECHO_TIMEOUT = 0.1  # s within which an interface returns sent frames
SEND_TIMEOUT = 0.002  # s for an interface to accept a frame
DEFAULTS = {  # options of an interface where the rig file has none
    "slcan": {"timeout": 0.0},  # python-can's waits a millisecond for every missing byte
    "udp_multicast": {"hop_limit": 0},  # frames stay on this machine: a neighbour's robot may use the same group
}
# for an adapter that was open until now; the default waits 2 s for it to start
STARTED = {"slcan": {"sleep_after_open": 0.0}}
# `recv` of these returns at once; others are received in a thread
NEVER_WAITS = {"robotell", "slcan", "udp_multicast", "virtual"}
# kinds that several processes of a machine may open: the control process holds one of its own, for its own stop
SHARED = {"socketcan", "udp_multicast"}
RECV_TIMEOUT = 0.05  # s of `recv` in such a thread, between checks for its end
RETRY_DELAY = 0.0005  # s between two attempts after a failure
CLOCK_STEP = 10e6  # ns by which the system clock may be set while messages are queued
ECHO_LIMIT = 1024  # different frames with an outstanding echo


class CannotOpen(Exception):
    """An interface that cannot be opened. The text states the reason."""


class Wire:
    """Interface without a bus: it receives nothing, and sends nothing.

    counts : {kind: number of frames}
    trouble : (errno, text) after the interface has failed, else None
    polled : whether frames may arrive, and there is no descriptor to wait for
    """

    polled = False

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.trouble: tuple[int, str] | None = None
        self.failures = 0

    def fileno(self) -> int | None:
        """Return the descriptor to poll for received frames; None if there is none."""
        return None

    def listen(self, replies: Sequence[EncodedReply]) -> None:
        """Receive these replies from here on, where the interface has filters. replies : replies in the plan"""

    def receive(self) -> list[tuple[int, bytes, int, int]]:
        """Return received frames as (identifier, data, arrival in ns of CLOCK_MONOTONIC, flags of CAN FD).

        The identifier has the flag bits of struct can_frame, the flags are those of struct canfd_frame. At most
        FRAMES_AT_ONCE frames are returned.
        """
        return []

    def send(self, identifier: int, data: bytes) -> bool:
        """Send a frame and return whether the interface accepted it. identifier : identifier with the flag bits"""
        return False

    def close(self) -> None:
        """Close the interface."""

    def count(self, kind: str) -> None:
        """Count a frame of a kind."""
        self.counts[kind] = self.counts.get(kind, 0) + 1

    def fail(self, number: int | None, words: str | None) -> None:
        """Mark the interface as failed; the first failure counts. number : errno, 0 if unknown; words : reason"""
        self.trouble = self.trouble or (number or errno.EIO, words or "unknown error")

    def failed_once(self, error: Exception) -> None:
        """Count a temporary failure; many in a row fail the interface."""
        self.failures += 1
        if self.failures >= INTERFACE_FAILURE_LIMIT:
            self.fail(_errno_of(error), str(error))


class PythonCanWire(Wire):
    """Any interface of python-can.

    Received frames are compared with those sent, since some interfaces return a sender's own frames as received ones.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        bitrate: int,
        fd: bool,
        options: dict[str, Any] | None = None,
        data_bitrate: int = 0,
    ) -> None:
        super().__init__()
        import can

        logging.getLogger("can").addHandler(logging.NullHandler())  # the caller reports errors
        self.message = can.Message
        try:
            given: dict = {"fd": True} if fd else {}
            if data_bitrate:
                given["data_bitrate"] = data_bitrate
            given |= DEFAULTS.get(interface, {}) | (options or {})
            self.bus = can.Bus(interface=interface, channel=channel, bitrate=bitrate, **given)
        except Exception as error:  # interfaces raise any exception
            raise CannotOpen(str(error) or type(error).__name__) from error
        try:
            if interface == "udp_multicast":
                keep_apart(self.bus.fileno())
            self.receiver = Stamped(self.bus) if interface in NEVER_WAITS else ReceiverThread(self.bus)
        except (OSError, RuntimeError) as error:  # no free descriptor, or no further thread
            with suppress(Exception):
                self.bus.shutdown()
            raise CannotOpen(str(error)) from error
        self.polled = self.fileno() is None
        self.fd, self.switching = fd, bool(data_bitrate)
        self.echoes = {}  # (id, data): times of sending with an outstanding echo

    def fileno(self) -> int | None:
        try:
            number = self.receiver.fileno()
        except NotImplementedError:
            return None
        return number if number >= 0 else None

    def receive(self) -> list[tuple[int, bytes, int, int]]:
        frames = []
        for _ in range(FRAMES_AT_ONCE):
            try:
                message, arrival = self.receiver.recv(0)
            except Exception as error:  # TypeError for half a frame on some serial lines
                self.failed_once(error)
                if _errno_of(error) or self.trouble:
                    break
                self.count("corrupt")
                if isinstance(error.__cause__, UnicodeDecodeError):
                    # slcan keeps a line that is not text, and then fails at every line after it
                    getattr(self.bus, "_buffer", bytearray()).clear()
                continue
            if message is None:
                break
            self.failures = 0
            frame = _identifier_of(message), bytes(message.data)
            if frame[0] & ERROR:
                self.count("errors")
            if self.is_echo(frame):
                self.count("echoes")
            else:
                flags = FD * message.is_fd | RATE_SWITCH * message.bitrate_switch
                frames.append((*frame, arrival, flags | ERROR_STATE * message.error_state_indicator))
        return frames

    def send(self, identifier: int, data: bytes) -> bool:
        now = time.monotonic()
        try:
            self.bus.send(
                self.message(
                    arbitration_id=identifier & 0x1FFFFFFF,
                    is_extended_id=bool(identifier & EXTENDED),
                    is_remote_frame=bool(identifier & REMOTE),
                    data=data,
                    is_fd=self.fd and len(data) > 8,
                    bitrate_switch=self.switching and len(data) > 8,
                ),
                timeout=SEND_TIMEOUT,
            )
        except Exception as error:
            self.count("refused")
            self.failed_once(error)
            return False
        self.failures = 0
        if len(self.echoes) >= ECHO_LIMIT:
            self.echoes = {frame: sent for frame, sent in self.echoes.items() if sent and now - sent[-1] < ECHO_TIMEOUT}
        sent = self.echoes.setdefault((identifier, data), deque())
        _drop_old(sent, now)
        sent.append(now)
        return True

    def is_echo(self, frame: tuple[int, bytes]) -> bool:
        """Return whether a frame is the echo of a sent one. A further or a late one is from another node."""
        sent = self.echoes.get(frame)
        if sent is None:
            return False
        _drop_old(sent, time.monotonic())
        if sent:
            sent.popleft()
            return True
        del self.echoes[frame]
        return False

    def close(self) -> None:
        with suppress(Exception):  # the interface may be disconnected
            self.receiver.close()
            self.bus.shutdown()


class Stamped:
    """A bus of python-can whose `recv` returns each message with its arrival in ns of CLOCK_MONOTONIC.

    A message arrives after the previous one, after the last time that the bus was empty, and before it is read. Its
    arrival is the time stamp of the interface, moved to within these limits: a step of the system clock shifts the
    stamps of queued messages. It is the time at which the message is read if the stamp is further off than CLOCK_STEP:
    some interfaces have no time stamps, and some stamp with a clock of the adapter.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.bus, self.fileno = bus, bus.fileno
        self.earliest = time.monotonic_ns()  # at which the next message may have arrived

    def recv(self, timeout: float) -> tuple[can.Message, int] | tuple[None, None]:
        """Return (message, arrival), (None, None) if there is none within `timeout` s."""
        began = time.monotonic_ns()
        message = self.bus.recv(timeout)
        if message is None:
            self.earliest = began
            return None, None
        now = time.monotonic_ns()
        stamp = message.timestamp * 1e9 - (time.time_ns() - now)
        near = self.earliest - CLOCK_STEP <= stamp <= now + CLOCK_STEP
        self.earliest = int(min(max(stamp, self.earliest), now)) if near else now
        return message, self.earliest

    def close(self) -> None:
        """The bus is closed by the wire."""


class ReceiverThread:
    """Thread that receives from a bus whose `recv` may wait longer than its timeout, with the methods of `Stamped`."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = Stamped(bus)
        self._received = deque(maxlen=ECHO_LIMIT)  # messages with their arrivals, and exceptions of the interface
        self.bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._ended = threading.Event()
        self.thread = threading.Thread(target=self._receive, name="receiver", daemon=True)
        self.thread.start()

    def _receive(self):
        while not self._ended.is_set():
            try:
                item = self.bus.recv(RECV_TIMEOUT)
            except Exception as error:
                item = error
            if item != (None, None):
                self._received.append(item)
                os.eventfd_write(self.bell, 1)
            if isinstance(item, Exception):
                self._ended.wait(RETRY_DELAY)

    def fileno(self) -> int:
        """Return an eventfd that is readable while messages are waiting."""
        return self.bell

    def recv(self, timeout: float) -> tuple[can.Message, int] | tuple[None, None]:
        """Return the next (message, arrival) at once, (None, None) if there is none.

        Raises the exceptions of the interface.
        """
        with suppress(BlockingIOError):
            os.eventfd_read(self.bell)
        if not self._received:
            return None, None
        item = self._received.popleft()
        if self._received:
            os.eventfd_write(self.bell, 1)
        if isinstance(item, Exception):
            raise item
        return item

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self.thread.join(4.0 * RECV_TIMEOUT)
        if not self.thread.is_alive():  # a thread that hangs in its interface may still use it
            os.close(self.bell)


class SocketCanWire(Wire):
    """Socket of the guardian on an interface that the loop drives; it receives nothing before `listen`."""

    FILTER, FD_FRAMES = 1, 5
    FRAME, FD_FRAME = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")

    def __init__(self, channel: str, fd: bool, virtual: bool, data_bitrate: int = 0) -> None:
        super().__init__()
        self.virtual, self.flags = virtual, RATE_SWITCH * bool(data_bitrate)
        try:
            self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
            self.socket.setsockopt(socket.SOL_CAN_RAW, self.FILTER, b"")
            if fd:
                self.socket.setsockopt(socket.SOL_CAN_RAW, self.FD_FRAMES, 1)
            self.socket.bind((channel,))
        except OSError as error:
            raise CannotOpen(f"{channel}: {error.strerror}") from error

    def fileno(self) -> int:
        return self.socket.fileno()

    def listen(self, replies: Sequence[EncodedReply]) -> None:
        """Receive replies from here on. replies : (id, mask, first bytes) of frames to receive"""
        filters = b"".join(struct.pack("=II", identifier, mask & ~ERROR) for identifier, mask, _ in replies)
        try:
            self.socket.setsockopt(socket.SOL_CAN_RAW, self.FILTER, filters)
        except OSError as error:  # the adapter is being unplugged
            self.fail(error.errno, error.strerror)

    def receive(self) -> list[tuple[int, bytes, int, int]]:
        frames = []
        for _ in range(FRAMES_AT_ONCE):
            try:
                frame, _, flags, _ = self.socket.recvmsg(self.FD_FRAME.size)
            except BlockingIOError:
                break
            except OSError as error:
                self.fail(error.errno, error.strerror)
                break
            if flags & socket.MSG_DONTROUTE and not self.virtual:
                self.count("echoes")
            elif len(frame) >= 8:
                identifier, length, flags = struct.unpack_from("=IBB", frame)
                flags = flags | FD if len(frame) == self.FD_FRAME.size else 0
                frames.append((identifier, frame[8 : 8 + length], time.monotonic_ns(), flags))
        return frames

    def send(self, identifier: int, data: bytes) -> bool:
        frame = (
            self.FRAME.pack(identifier, len(data), data)
            if len(data) <= 8
            else self.FD_FRAME.pack(identifier, len(data), self.flags, data)
        )
        try:
            self.socket.send(frame)
        except OSError as error:
            self.count("refused")
            if error.errno not in (errno.ENOBUFS, errno.EAGAIN):
                self.fail(error.errno, error.strerror)
            return False
        return True

    def close(self) -> None:
        self.socket.close()


class Unwatched(Wire):
    """Bus that the loop drives without actuators: nothing to stop, and nothing to receive."""


def open_wire(bus: PlanBus, again: bool = False) -> Wire:
    """Open the wire of a bus of the plan. Raises CannotOpen. again : its adapter was open until now"""
    if bus["interface"] == "udp":
        return Unwatched()
    if bus["interface"] == "socketcan":
        return SocketCanWire(bus["channel"], bus["fd"], bus["virtual"], bus["data_bitrate"])
    options = (bus.get("options") or {}) | (STARTED.get(bus["interface"], {}) if again else {})
    return PythonCanWire(bus["interface"], bus["channel"], bus["bitrate"], bus["fd"], options, bus["data_bitrate"])


def load(interface: str) -> None:
    """Import what an interface of python-can needs."""
    import can.interfaces

    if interface in can.interfaces.BACKENDS:
        with suppress(Exception):  # it is reported when the interface is opened
            import_module(can.interfaces.BACKENDS[interface][0])


def _drop_old(sent, now):
    """Drop times that are too old for an echo."""
    while sent and now - sent[0] >= ECHO_TIMEOUT:
        sent.popleft()


def keep_apart(descriptor: int) -> None:
    """Restrict a socket to its own multicast group.

    By default it receives all groups that any process of this machine has joined. Frames received so far, perhaps from
    the drives of another robot, are discarded.
    """
    with socket.socket(fileno=os.dup(descriptor)) as twin:
        if twin.family == socket.AF_INET6:
            twin.setsockopt(socket.IPPROTO_IPV6, IPV6_MULTICAST_ALL, 0)
        else:
            twin.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
        with suppress(BlockingIOError):
            for _ in range(10_000):
                twin.recv(1, socket.MSG_DONTWAIT)


def _identifier_of(message):
    return (
        message.arbitration_id
        | EXTENDED * message.is_extended_id
        | REMOTE * message.is_remote_frame
        | ERROR * message.is_error_frame
    )


def _errno_of(error):
    """Return the errno of an interface's exception, 0 if it has none."""
    while error is not None:
        if isinstance(error, OSError) and error.errno:
            return error.errno
        error = error.__cause__
    return 0
