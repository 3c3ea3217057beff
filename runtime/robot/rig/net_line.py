"""Network lines: UDP datagrams to a port of this computer, or a TCP connection to a server.

Keys of `opening`:

    transport   "udp" or "tcp"
    address     "HOST:PORT": for udp of this computer, such as 0.0.0.0:5005 for all its networks; for tcp of the server

A lost connection is made again as soon as the server accepts it.
"""

from __future__ import annotations

import errno
import os
import socket
from typing import TYPE_CHECKING

from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.line import Opened, one_by_one

if TYPE_CHECKING:
    from collections.abc import Iterable

    from graph import StreamDevice


CONNECT_TIMEOUT = 3.0  # s


def open_lines(devices: Iterable[StreamDevice]) -> dict[StreamDevice, Opened | RigProblem]:
    """Open the lines of `devices`. Returns {device: Opened or RigProblem}."""
    return one_by_one(devices, lambda device: open_line(device.path, **device.opening()))


def open_line(path: str, transport: str, address: str) -> Opened:
    """Open a network line. path : device named in messages. Raises Refused."""
    name = f'[device."{path}"] address = "{address}"'
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise Refused(RigProblem("TW102", f"{name}: expected HOST:PORT", 'as in address = "0.0.0.0:5005"'))
    try:
        if transport == "udp":
            end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 18)
            end.bind((host, int(port)))
        else:
            end = socket.create_connection((host, int(port)), CONNECT_TIMEOUT)
    except OSError as error:
        raise Refused(_open_problem(name, transport, port, error)) from None
    end.setblocking(False)
    return Opened(end.detach(), f"{transport} {address}", reconnects=transport == "tcp")


def _open_problem(name, transport, port, error):
    """Return a RigProblem that explains why a line cannot be opened."""
    if isinstance(error, socket.gaierror):
        return RigProblem("TW122", f"{name}: {error.strerror}", "write an IP address, as in 192.168.1.7:5005")
    if transport == "udp" and error.errno == errno.EADDRINUSE:
        hint = f"end that program or choose another port; find it: ss -lunp sport = :{port}"
        return RigProblem("TW121", f"{name}: UDP port {port} is in use by another program", hint)
    if transport == "udp" and error.errno == errno.EADDRNOTAVAIL:
        return RigProblem(
            "TW122",
            f"{name} is an address of another machine",
            f"for udp, use an address of this computer: 0.0.0.0:{port}",
        )
    if error.errno == errno.EACCES:
        return RigProblem("TW123", f"{name}: {os.strerror(error.errno)}", "choose a port above 1023")
    if transport == "tcp":
        reason = "no reply" if isinstance(error, TimeoutError) else os.strerror(error.errno)
        return RigProblem(
            "TW128", f"{name}: {reason}", "check that the bridge is running, and the firewall of its computer"
        )
    return RigProblem("TW119", f"{name}: {os.strerror(error.errno)}", "check that the address belongs to this computer")
