"""Lines over a network: datagrams that come to a port of this computer, or a connection to a program that waits for
one.

What a block says in `opening`:

    transport   "udp" or "tcp"
    address     "HOST:PORT": of this computer for udp, such as 0.0.0.0:5005 for any of its networks; of the other end
    for tcp

A connection that is lost is made anew as soon as the program at the other end waits again.
"""

import errno
import os
import socket

from runtime.rig.errors import Refused, Trouble
from runtime.rig.streams import Opened, one_by_one

PATIENCE = 3.0  # s for a connection


def open_lines(devices):
    """{device: Opened or Trouble}"""
    return one_by_one(devices, lambda device: opened(device.path, **device.opening()))


def opened(who, transport, address):
    name = f'[device."{who}"] address = "{address}"'
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise Refused(Trouble("TW102", f"{name}: expected HOST:PORT", 'as in address = "0.0.0.0:5005"'))
    try:
        if transport == "udp":
            end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 18)
            end.bind((host, int(port)))
        else:
            end = socket.create_connection((host, int(port)), PATIENCE)
    except OSError as error:
        raise Refused(in_words(name, transport, port, error)) from None
    end.setblocking(False)
    return Opened(end.detach(), f"{transport} {address}", reconnects=transport == "tcp")


def in_words(name, transport, port, error):
    if isinstance(error, socket.gaierror):
        return Trouble("TW122", f"{name}: {error.strerror}", "write the number of the computer, as in 192.168.1.7:5005")
    if transport == "udp" and error.errno == errno.EADDRINUSE:
        hint = f"end that one, or choose another port; who it is: ss -lunp sport = :{port}"
        return Trouble("TW121", f"{name}: another program has UDP port {port} open", hint)
    if transport == "udp" and error.errno == errno.EADDRNOTAVAIL:
        return Trouble(
            "TW122",
            f"{name} is an address of another machine",
            f"for udp it is where this computer listens: 0.0.0.0:{port}",
        )
    if error.errno == errno.EACCES:
        return Trouble("TW123", f"{name}: {os.strerror(error.errno)}", "choose a port above 1023")
    if transport == "tcp":
        said = "nobody answers" if isinstance(error, TimeoutError) else os.strerror(error.errno)
        return Trouble(
            "TW128", f"{name}: {said}", "is the bridge running, and does its computer's firewall let it be reached?"
        )
    return Trouble("TW119", f"{name}: {os.strerror(error.errno)}", "is that address one of this computer?")
