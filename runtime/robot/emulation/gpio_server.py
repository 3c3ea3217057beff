"""Emulated GPIO line, behind a socket that the run opens in place of a chip: events as those of Linux.

to the run      struct gpio_v2_line_event of <linux/gpio.h>, one per edge; its level on connection, as an event
from the run    one byte, the level of an output
"""

from __future__ import annotations

import socket
import struct
import time
from pathlib import Path

from runtime.host.errors import BadInput
from runtime.robot.emulation.socket_server import SocketServer
from runtime.robot.rig.gpio_line import EMULATED, EVENT, socket_path

BYTES, LOST, LEVEL = 0, 1, 3  # ids of cext/lines/stream_frames.pxd
FALLING, RISING = 2, 1
TIME = struct.Struct("=Q")  # of an event, ns of CLOCK_MONOTONIC, at its begin
KIND = struct.Struct("=QI")


class GpioServer(SocketServer):
    """Thread that sends the edges of one line to the run, and the level set by the run to the plant.

    name : name of the device; chip, pin and the others : values of its `opening`
    Raises BadInput for a real chip, a socket that cannot be made, or one of a running emulator.
    """

    def __init__(self, name: str, chip: str, pin: str, **_: object) -> None:
        if not chip.startswith(EMULATED):
            raise BadInput(
                f'[device."{name}"] chip = "{chip}": a line of a real GPIO chip cannot be emulated. Write chip = '
                f'"{EMULATED}/tmp/chip" in the rig file of the run and of emulate'
            )
        path = socket_path(chip, pin)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
            if probe.connect_ex(path) == 0:
                raise BadInput(f"{path} has an emulator. End that process first")
        self.newest, self.lost, self.description = b"", False, f"socket {path}"
        super().__init__(Path(path))

    def take(self) -> None:
        """Send the edges to the run. A disconnected chip closes the connection, and accepts no other."""
        for identifier, data, _ in self.lines.take(0):
            if identifier == LOST:
                self.lost = True
                for client in list(self.clients):
                    self.attempt(self.welcome, client)
                continue
            if identifier == LEVEL:
                data = KIND.pack(0, RISING if data[0] else FALLING).ljust(EVENT, b"\0")
            self.newest = TIME.pack(time.monotonic_ns()) + data[TIME.size :]
            for client in list(self.clients):
                self.attempt(self.welcome, client)

    def welcome(self, client: socket.socket) -> None:
        """Send the newest event, which is the level."""
        if self.lost:
            raise ConnectionError
        client.setblocking(False)
        if self.newest:
            client.send(self.newest)

    def serve(self, client: socket.socket) -> None:
        """Pass the level of an output to the plant."""
        level = client.recv(1)
        if not level:
            raise ConnectionError
        self.lines.give(0, BYTES, level, time.monotonic_ns())
