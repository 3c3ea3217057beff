"""Handover of a bus to a new run, from a safe stop that continues after the end of its run.

    the process of the stop                     the new run
    accepts connections beside the lock     <-  connects, as the bus is locked
    sends the lock, and its drives          ->  takes the lock, if the drives belong to its diagram
                                            <-  OPEN: its guardian is about to open the interface
    sends no more, and closes its interface
    CLOSED                                  ->  opens the interface, and sends the frames of the safe stop
                                            <-  SENT, with each round of them
                                            <-  ARMING: its loop asks the drives now
    ends, once it has no other bus

So the drives are attended at all times. A connection that ends without ARMING is that of a run that did not begin: the
process of the stop opens its interface again, and continues. It does the same after SILENCE without a message, as the
new run may be stopped or hang, and sends TAKEN. The new run then repeats this from OPEN on.
"""

from __future__ import annotations

import json
import os
import select
import socket
import struct
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from cext.safety.thresholds import BUS_LOCK_RELEASE_LIMIT, STOP_ROUND_MAXIMUM

if TYPE_CHECKING:
    from collections.abc import Iterable

    from runtime.robot.guardian.interfaces import Interfaces
    from runtime.robot.guardian.plan_types import PlanLock
    from runtime.robot.guardian.stop import SafeStop

OPEN, CLOSED, SENT, TAKEN, ARMING = b"o", b"c", b"s", b"t", b"a"
# ns without a message, after which a new run counts as stopped; twice that next time while its interface does not open
SILENCE = 3 * STOP_ROUND_MAXIMUM
CREDENTIALS = struct.Struct("iII")  # struct ucred: pid, uid, gid
OFFER_BYTES = 1 << 16  # limit


def peer_of(link: socket.socket) -> tuple[int, int]:
    """Return (process ID, account ID) of the process at the other end of a socket, or that listens there."""
    return CREDENTIALS.unpack(link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size))[:2]


def beside(name: bytes) -> bytes:
    """Return the name at which a bus is handed over. name : name of the bus's lock"""
    return name.replace(b"\0tickwork/bus/", b"\0tickwork/stop/", 1)


class Offer:
    """Offer of a bus whose safe stop continues.

    name : name of the bus's lock

    Raises ConnectionRefusedError if there is none, OSError if its process does not answer.

    drives : names of the drives that have not confirmed
    identifiers : identifiers of the drives' stop frames, with flag bits
    """

    def __init__(self, name: bytes) -> None:
        self.link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self.link.settimeout(BUS_LOCK_RELEASE_LIMIT * 1e-9)
            self.link.connect(beside(name))
            words, descriptors, _, _ = socket.recv_fds(self.link, OFFER_BYTES, 1)
            if not descriptors:
                raise ConnectionRefusedError
        except OSError:
            self.link.close()
            raise
        self.lock = socket.socket(fileno=descriptors[0])
        offered = json.loads(words)
        self.drives, self.identifiers = offered["drives"], set(offered["identifiers"])

    def accept(self) -> tuple[socket.socket, socket.socket]:
        """Take the bus. Returns (lock, connection for `Successor`)."""
        self.lock.listen(socket.SOMAXCONN)  # from here on it names this process
        self.link.setblocking(True)
        return self.lock, self.link

    def decline(self) -> None:
        """Leave the bus to its process."""
        self.lock.close()
        self.link.close()


class Successor:
    """The new run's end of a handover, in its guardian. descriptor : file descriptor of the connection"""

    def __init__(self, descriptor: int) -> None:
        self.link = socket.socket(fileno=descriptor)
        self.link.settimeout(BUS_LOCK_RELEASE_LIMIT * 1e-9)

    def open(self) -> None:
        """Let the other process close its interface. Where it has died, there is nothing to close."""
        with suppress(OSError):
            self.link.send(OPEN)
            while self.link.recv(1) == TAKEN:  # before
                pass

    def sent(self) -> None:
        """Report that the frames of the safe stop were sent."""
        with suppress(OSError):
            self.link.send(SENT)

    def was_taken(self) -> bool:
        """Return whether the other process has taken the bus back since `open`."""
        try:
            return bool(select.select([self.link], [], [], 0)[0]) and self.link.recv(1) == TAKEN
        except OSError:
            return False

    def arming(self) -> None:
        """Let the other process end: the loop of this run asks the drives now."""
        with suppress(OSError):
            self.link.send(ARMING)
        self.link.close()


class Handover:
    """Offer of the buses of a safe stop that continues.

    locks : locks in the plan; interfaces : interfaces of its buses, whose poll object also waits for new runs
    """

    def __init__(self, locks: Iterable[PlanLock], interfaces: Interfaces) -> None:
        self._locks = dict(enumerate(locks))  # of the buses that no other run has taken
        self._interfaces, self._poll = interfaces, interfaces.poll
        self._listeners: dict[int, socket.socket] = {}  # by the place of the lock
        self._links: dict[int, socket.socket] = {}
        self._heard: dict[int, int] = {}  # ns of the newest message of a run that has a bus, by the place of its lock
        self._silence: dict[int, int] = {}  # ns, longest without one
        self._again = 0  # ns at which to try again to accept connections

    def attend(self, now: int, stop: SafeStop) -> None:
        """Take the buses back of runs that are silent, and accept connections from here on.

        Call it again and again: it may lack a descriptor, or a name be in use. now : ns of CLOCK_MONOTONIC
        """
        for place, heard in list(self._heard.items()):
            if now - heard >= self._silence[place]:
                self._silence[place] *= 2
                self._take_back(place, stop)
                with suppress(OSError):
                    self._links[place].send(TAKEN)
        if now < self._again:
            return
        self._again = now + STOP_ROUND_MAXIMUM
        for place, lock in self._locks.items():
            with suppress(OSError):  # no free descriptor, or the process of an earlier stop still has the name
                if place not in self._listeners:
                    self._listeners[place] = _listener(beside(lock["name"].encode()))
                self._poll.register(self._listeners[place], select.POLLIN)

    def handle(self, descriptor: int, stop: SafeStop | None) -> list[str]:
        """Handle an event. Returns lines of text about a bus that another run has taken."""
        lines = []
        for place, listener in list(self._listeners.items()):
            link = self._links.get(place)
            if stop is not None and descriptor in (listener.fileno(), -1 if link is None else link.fileno()):
                if link is not None:  # first, as it may have ended before the next connection
                    lines += self._proceed(place, link, stop)
                if place in self._listeners:
                    self._accept(place, listener, stop)
        return lines

    def _accept(self, place, listener, stop):
        """Accept a connection, if there is one."""
        try:
            link = listener.accept()[0]
        except BlockingIOError:
            return
        except OSError:  # no free descriptor
            with suppress(KeyError):
                self._poll.unregister(listener)  # until the next `offer`
            return
        if place in self._links or peer_of(link)[1] not in (os.getuid(), 0):
            link.close()  # it is being handed over to another run, or this one is of another account
            return
        lock = self._locks[place]
        devices = [stop.stopped[name] for name in stop.waiting if stop.stopped[name]["bus"] == lock["bus"]]
        identifiers = {identifier for device in devices for identifier, _ in device["zero"] + device["disable"]}
        offer = {"drives": [device["name"] for device in devices], "identifiers": sorted(identifiers)}
        with suppress(OSError):  # it has ended
            socket.send_fds(link, [json.dumps(offer).encode()], [lock["descriptor"]])
        link.setblocking(False)
        self._links[place], self._silence[place] = link, SILENCE
        self._poll.register(link, select.POLLIN)

    def _proceed(self, place, link, stop):
        """Handle a message of a new run. Returns lines of text if it has taken the bus."""
        bus = self._locks[place]["bus"]
        try:
            message = link.recv(1)
        except BlockingIOError:
            return []
        except OSError:
            message = b""
        if message == OPEN and bus is not None:
            self._heard[place] = time.monotonic_ns()
            stop.lent.add(bus)
            self._interfaces.close(bus)
            with suppress(OSError):
                link.send(CLOSED)
        elif message == SENT and place in self._heard:
            self._heard[place], self._silence[place] = time.monotonic_ns(), SILENCE  # its interface is open
        if message in (OPEN, SENT):
            return []
        process, drives = peer_of(link)[0], [name for name in stop.waiting if stop.stopped[name]["bus"] == bus]
        self._close(self._links.pop(place))
        if message == ARMING:
            self._heard.pop(place, None)
            del self._locks[place]
            self._close(self._listeners.pop(place))
            if bus is not None:
                stop.lent.add(bus)
                stop.given.add(bus)
                self._interfaces.close(bus)
        else:
            self._take_back(place, stop)
        if message != ARMING or not drives:
            return []
        return [f"process {process} continues the stop of {', '.join(drives)}, and asks for their state"]

    def _take_back(self, place, stop):
        """Let the stop open the interface of a bus again that a new run has."""
        if self._heard.pop(place, None) is not None:
            stop.lent.discard(self._locks[place]["bus"])
            stop.failing.add(self._locks[place]["bus"])

    def _close(self, each):
        """Close a socket."""
        with suppress(KeyError):  # a listener that lacked a descriptor
            self._poll.unregister(each)
        each.close()

    def close(self) -> None:
        """Withdraw the offers."""
        for each in (*self._listeners.values(), *self._links.values()):
            self._close(each)
        self._listeners, self._links = {}, {}


def _listener(name):
    """Return a socket that accepts connections at a name. Raises OSError."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    try:
        listener.bind(name)
        listener.listen()
    except OSError:
        listener.close()
        raise
    return listener
