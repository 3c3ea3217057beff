"""Emulated chips of an SPI bus, behind a socket that the run opens in place of /dev/spidev0.0."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

from blocks.spi import SpiDevice
from runtime.robot.emulation.i2c_server import ANSWER_TIMEOUT, I2cServer
from runtime.robot.emulation.socket_server import SocketServer


class EmulatedSpiChip:
    """Chip of one device. device : device of the robot"""

    def __init__(self, device: SpiDevice) -> None:
        self.chip = device.chip()
        self.answers: dict[int, tuple[float, bytes]] = {}  # {number of the transfer: (time, bytes)}
        self.transfers = {transfer.number: transfer for one in device.rounds() for transfer in one.transfers}

    def shift(self, sent: bytes) -> bytes:
        """Return the bytes that the chip sends meanwhile."""
        newest = max(self.answers.values(), default=None)
        fresh = newest is not None and newest[0] >= time.monotonic() - ANSWER_TIMEOUT
        return self.chip.shift(sent, newest[1] if newest is not None and fresh else None)


class SpiServer(I2cServer):
    """Thread that answers the transfers of a run.

    channel : path of the socket
    pairs : (device of the robot, its emulator) of each device on this bus

    Raises BadInput if the socket cannot be made.
    """

    def __init__(self, channel: Path, pairs: Iterable[tuple[SpiDevice, SpiDevice]]) -> None:
        self.chips = {(0, device.address): EmulatedSpiChip(device) for device, _ in pairs}
        SocketServer.__init__(self, channel)

    def exchange(self, address: int, register: int, data: bytes, count: int, reads: bool) -> bytes:
        """Return the bytes received during a transfer; 0xFF from a chip select without a chip."""
        chip = self.chips.get((0, address))
        return b"\xff" * len(data) if chip is None else chip.shift(data)
