"""Where tests find real SocketCAN: an interface vcan0, on this machine or under User Mode Linux.

A machine with vcan0 runs them as they are. Elsewhere test_user_mode_linux.py starts a kernel that has it and runs them
there, with REQUIRED set: then nothing is skipped.
"""

import os
import socket
import struct
import subprocess
from pathlib import Path

import pytest

REQUIRED = "TICKWORK_REAL_CAN"
CLASSIC = struct.Struct("=IB3x8s")  # struct can_frame
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000

there = Path("/sys/class/net/vcan0").exists()
needs_own_kernel = pytest.mark.skipif(
    not os.environ.get(REQUIRED), reason="changes interfaces or the wall clock: under User Mode Linux alone"
)
needs_vcan = pytest.mark.skipif(not there and not os.environ.get(REQUIRED), reason="needs the CAN interface vcan0")


def ip(*words):
    """Change an interface. As root, on a machine of our own."""
    subprocess.run(["ip", "link", *words], check=True, capture_output=True)


class Node:
    """Somebody else on the bus."""

    def __init__(self, channel="vcan0"):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setblocking(False)
        self.socket.bind((channel,))

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.socket.close()

    def send(self, identifier, data=b""):
        self.socket.send(CLASSIC.pack(identifier, len(data), data))

    def heard(self):
        """(id, data) of every frame that has come."""
        frames = []
        while True:
            try:
                identifier, length, data = CLASSIC.unpack(self.socket.recv(CLASSIC.size))
            except BlockingIOError:
                return frames
            frames.append((identifier, data[:length]))
