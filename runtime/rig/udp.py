"""UDP as a bus: each datagram is one classic CAN frame, 16 bytes, as Linux has it in struct can_frame on a
little-endian machine.

    bytes 0 to 3    id, least significant byte first; bit 31 set for an extended id
    byte 4          how many data bytes there are, 0 to 8
    bytes 5 to 7    0
    bytes 8 to 15   the data

For buttons and sensors that come over a network. The loop receives by itself; the guardian has no part in it, so no
actuator may be on such a bus.
"""

import errno
import ipaddress
import os
import socket
from contextlib import suppress
from pathlib import Path

from runtime.rig.errors import Refused, Trouble

UDP = "udp"
SO_TIMESTAMPNS = 35  # of Linux, which Python's socket has no name for
ROOM = 128 * 1024  # bytes: some hundred datagrams. What waits longer than a few ticks is better lost
EXAMPLE = '"0.0.0.0:9871" (any address of this machine), "127.0.0.1:9871" or "[::]:9871"'


class Endpoint(tuple):
    """(address, port) of a channel such as 0.0.0.0:9871 or [::]:9871. ValueError, which says why, if it is none."""

    def __new__(cls, text):
        host, colon, port = text.rpartition(":")
        bracketed = host.startswith("[") and host.endswith("]")
        if not colon or (":" in host and not bracketed):
            raise ValueError("expected ADDRESS:PORT")
        try:
            address = ipaddress.ip_address(host[1:-1] if bracketed else host)
        except ValueError:
            raise ValueError(f"{host!r} is no address: a name would have to be looked up") from None
        if bracketed != (address.version == 6):
            raise ValueError("an IPv6 address, and no other, stands in [ ]")
        if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
            raise ValueError(f"{port!r} is no port: 1 to 65535")
        return super().__new__(cls, (str(address), int(port)))

    @property
    def family(self):
        return socket.AF_INET6 if ":" in self[0] else socket.AF_INET


class UdpInterface:
    """A UDP socket that has been bound. Refused, with the cause in words.

    bus : RigBus; with a `peer`, what is sent goes there, and its datagrams alone are heard
    devices : that are on it

    socket, remarks, virtual, strangers : as runtime.rig.interface.Interface has them
    """

    virtual, strangers = True, None

    def __init__(self, bus, devices):
        self.bus, self.remarks = bus, []
        moving = [device.path for device in devices if device.zero_frames() or device.disable_frames()]
        if moving:
            raise Refused(
                Trouble(
                    "TW105",
                    f"[bus.{bus.name}] interface = {UDP!r} cannot carry {', '.join(moving)}: the guardian could "
                    "not stop it",
                    "UDP is for buttons and sensors; put what moves on CAN",
                )
            )
        here = Endpoint(bus.channel)
        self.socket = socket.socket(here.family, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM)
            self.socket.bind(here)
            if bus.peer:
                self.socket.connect(Endpoint(bus.peer))
        except OSError as error:
            self.close()
            raise Refused(in_words(bus, here, error)) from None

    def close(self):
        self.socket.close()


def in_words(bus, here, error):
    """Why a socket could not be bound, as a Trouble."""
    address, port = here
    if error.errno == errno.EADDRINUSE:
        owner = owner_of(port)
        return Trouble(
            "TW121",
            f"[bus.{bus.name}] UDP port {port} is in use" + (f" by {owner}" if owner else ""),
            "end that one first, or take another port here and at whoever sends",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        own = ", ".join(addresses())
        return Trouble(
            "TW122",
            f"[bus.{bus.name}] {address} is no address of this machine" + (f"; it has {own}" if own else ""),
            f'write channel = "{"[::]" if ":" in address else "0.0.0.0"}:{port}" for any of its addresses',
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return Trouble(
            "TW123",
            f"[bus.{bus.name}] port {port} is a privileged one: {error.strerror}",
            "take a port from 1024 on, such as 9871",
        )
    return Trouble("TW119", f"[bus.{bus.name}] udp {bus.channel}: {error.strerror}", "look at: ip address; ss -ulnp")


def failed(trouble, bus):
    """Why a bus failed in a run, and the cure: two lines. trouble : errno"""
    if trouble == errno.ECONNREFUSED:
        return f"nobody listens at {bus.peer}", "is its power on, and its program running?"
    if trouble in (errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN):
        return f"there is no way to {bus.peer}: {os.strerror(trouble)}", "look at: ip address; ip route"
    return (
        f"udp {bus.channel}: {os.strerror(trouble) if trouble and trouble > 0 else 'it takes no datagrams'}",
        "look at: ip address; ss -ulnp",
    )


def owner_of(port):
    """'NAME (process PID)' of who has bound a UDP port, as far as this user may see; "" where it is not to be seen."""
    inodes = set()
    for table in ("udp", "udp6"):
        with suppress(OSError):
            for line in Path("/proc/net", table).read_text().splitlines()[1:]:
                words = line.split()
                if int(words[1].rpartition(":")[2], 16) == port:
                    inodes.add(f"socket:[{words[9]}]")
    return holder_of(lambda target: target in inodes)


def holder_of(is_it):
    """'NAME (process PID)' of the first process that has a file open, as far as this user may see. is_it : of what its
    descriptor points at
    """
    for folder in sorted(Path("/proc").glob("[0-9]*"), key=lambda path: int(path.name)):
        with suppress(OSError):
            for descriptor in (folder / "fd").iterdir():
                with suppress(OSError):
                    if is_it(os.readlink(descriptor)):
                        return f"{(folder / 'comm').read_text().strip()} (process {folder.name})"
    return ""


def addresses():
    """IPv4 addresses of this machine."""
    found = set()
    with suppress(OSError):
        before = ""
        for line in Path("/proc/net/fib_trie").read_text().splitlines():
            if line.strip().startswith("/32 host LOCAL"):
                found.add(before.split()[-1])
            before = line
    return sorted(found, key=lambda text: tuple(map(int, text.split("."))))
