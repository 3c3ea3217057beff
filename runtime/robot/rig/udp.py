"""UDP as a bus: each datagram is one classic CAN frame of 16 bytes, a little-endian struct can_frame of Linux.

    bytes 0 to 3    id, least significant byte first; bit 31 set for an extended id
    byte 4          number of data bytes, 0 to 8
    bytes 5 to 7    0
    bytes 8 to 15   the data

For buttons and sensors on a network. Only the loop receives and sends, not the guardian, so actuators are not allowed
on such a bus. With a `key` the datagrams are signed (runtime.host.signed_datagrams), and another process verifies them.
"""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.host.signed_datagrams import MAKE_KEY, read_key
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.verifier import Verifier

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from graph import Device
    from runtime.robot.rig.bus import RigBus


UDP = "udp"
SO_TIMESTAMPNS = 35  # Linux constant that Python's socket lacks
RECEIVE_BUFFER = 128 * 1024  # bytes: some hundred datagrams; losing older ones is better than reading them late
EXAMPLE = '"0.0.0.0:9871" (any address of this machine), "127.0.0.1:9871" or "[::]:9871"'


class Endpoint(tuple):
    """(address, port) of a channel such as 0.0.0.0:9871 or [::]:9871. Raises ValueError with the reason."""

    def __new__(cls, text: str) -> Endpoint:
        host, colon, port = text.rpartition(":")
        bracketed = host.startswith("[") and host.endswith("]")
        if not colon or (":" in host and not bracketed):
            raise ValueError("expected ADDRESS:PORT")
        try:
            address = ipaddress.ip_address(host[1:-1] if bracketed else host)
        except ValueError:
            raise ValueError(f"{host!r} is not an IP address: host names are not looked up") from None
        if bracketed != (address.version == 6):
            raise ValueError("only an IPv6 address is written in [ ]")
        if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
            raise ValueError(f"{port!r} is not a port from 1 to 65535")
        return super().__new__(cls, (str(address), int(port)))

    @property
    def family(self) -> socket.AddressFamily:
        """Address family of its socket: IPv4 or IPv6."""
        return socket.AF_INET6 if ":" in self[0] else socket.AF_INET


class UdpInterface:
    """Bound UDP socket. Raises Refused with the cause.

    bus : RigBus; its `peer`, if any, is the destination, and the only accepted source
    devices : devices on the bus

    socket, remarks, virtual, strangers : as runtime.robot.rig.interface.Interface has them
    """

    virtual, strangers = True, None

    def __init__(self, bus: RigBus, devices: Sequence[Device]) -> None:
        self.bus, self.remarks, self.verifier = bus, [], None
        moving = [device.path for device in devices if device.zero_frames() or device.disable_frames()]
        if moving:
            raise Refused(
                RigProblem(
                    "TW105",
                    f"[bus.{bus.name}] interface = {UDP!r} cannot carry {', '.join(moving)}: the guardian could "
                    "not stop it",
                    "UDP is for buttons and sensors; connect actuators by CAN",
                )
            )
        local, key = Endpoint(bus.channel), _key_of(bus)
        self.socket = socket.socket(local.family, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            self.socket.bind(local)
            if bus.peer:
                self.socket.connect(Endpoint(bus.peer))
        except OSError as error:
            self.close()
            raise Refused(_open_problem(bus, local, error)) from None
        if key is not None:
            self._verify(key)

    def _verify(self, key):
        """Receive the frames of signed datagrams from another process instead."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        with self.socket as received, theirs:
            self.verifier = Verifier(key, received, theirs)
        ours.setblocking(False)
        ours.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.socket = ours

    def close(self) -> None:
        """Close the socket, and end the process that verifies datagrams."""
        if self.verifier is not None:
            self.verifier.close()
        self.socket.close()


def _key_of(bus):
    """Return the key of a bus, None without one. Raises Refused."""
    if not bus.key:
        return None
    try:
        return read_key(bus.key)
    except ValueError as error:
        make = MAKE_KEY.format(path=bus.key)
        raise Refused(
            RigProblem("TW139", f"[bus.{bus.name}] key = {bus.key!r}: {error}", f"create it: {make}")
        ) from None


def _open_problem(bus, local, error):
    """Return a RigProblem that explains why a socket could not be bound."""
    address, port = local
    if error.errno == errno.EADDRINUSE:
        owner = owner_of(port)
        return RigProblem(
            "TW121",
            f"[bus.{bus.name}] UDP port {port} is in use" + (f" by {owner}" if owner else ""),
            "end that process first, or use another port here and at the sender",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        own = ", ".join(addresses())
        return RigProblem(
            "TW122",
            f"[bus.{bus.name}] {address} is not an address of this machine" + (f"; it has {own}" if own else ""),
            f'write channel = "{"[::]" if ":" in address else "0.0.0.0"}:{port}" for any of its addresses',
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return RigProblem(
            "TW123",
            f"[bus.{bus.name}] port {port} is privileged: {error.strerror}",
            "use a port from 1024 on, such as 9871",
        )
    return RigProblem("TW119", f"[bus.{bus.name}] udp {bus.channel}: {error.strerror}", "see: ip address; ss -ulnp")


def failure_in_words(error: int | str | None, bus: RigBus) -> tuple[str, str]:
    """Return (why a bus failed in a run, remedy). error : errno"""
    if error == errno.ECONNREFUSED:
        return f"no program receives at {bus.peer}", "check its power and its program"
    if error in (errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN):
        return f"no route to {bus.peer}: {os.strerror(error)}", "see: ip address; ip route"
    reason = os.strerror(error) if isinstance(error, int) and error > 0 else "it accepts no datagrams"
    return f"udp {bus.channel}: {reason}", "see: ip address; ss -ulnp"


def owner_of(port: int) -> str:
    """Return 'NAME (process PID)' of the process that has bound a UDP port; "" if this user cannot see it."""
    inodes = set()
    for table in ("udp", "udp6"):
        with suppress(OSError):
            for line in Path("/proc/net", table).read_text().splitlines()[1:]:
                words = line.split()
                if int(words[1].rpartition(":")[2], 16) == port:
                    inodes.add(f"socket:[{words[9]}]")
    return holder_of(lambda target: target in inodes)


def holder_of(is_it: Callable[[str], bool]) -> str:
    """Return 'NAME (process PID)' of the first process with a matching open file; "" if this user cannot see it.

    is_it : predicate of the target of a descriptor link
    """
    for folder in sorted(Path("/proc").glob("[0-9]*"), key=lambda path: int(path.name)):
        with suppress(OSError):
            for descriptor in (folder / "fd").iterdir():
                with suppress(OSError):
                    if is_it(os.readlink(descriptor)):
                        return f"{(folder / 'comm').read_text().strip()} (process {folder.name})"
    return ""


def addresses() -> list[str]:
    """Return the IPv4 addresses of this machine."""
    own = set()
    with suppress(OSError):
        before = ""
        for line in Path("/proc/net/fib_trie").read_text().splitlines():
            if line.strip().startswith("/32 host LOCAL"):
                own.add(before.split()[-1])
            before = line
    return sorted(own, key=lambda text: tuple(map(int, text.split("."))))
