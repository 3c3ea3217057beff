"""Emulated chips of an I2C bus, behind a socket that the run opens in place of /dev/i2c-1.

The devices' own tables of reads (blocks.i2c) map the answers of their emulators to registers. A register that the run
has written keeps its bytes. If several answers contain one register, as with the channels of a converter, the run reads
the answer whose other registers equal those that it has written.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from blocks.i2c import CHANNELS, MUX, I2cDevice, Identity, Read, Transfer
from runtime.robot.emulation.socket_server import SocketServer

REQUEST_HEADER, PACKET_BYTES = 6, 64
ANSWER_TIMEOUT = 0.1  # s without an answer of its emulator after which a chip does not acknowledge its data


class EmulatedChip:
    """Registers of one device.

    device : device of the robot
    emulator : emulator of the plant, which supplies the answers
    """

    def __init__(self, device: I2cDevice, emulator: I2cDevice) -> None:
        self.device, self.read_only = device, set()
        self.written: set[tuple[int, int]] = set()
        self.registers: dict[tuple[int, int], int] = {}  # {(address, number of the byte): byte}
        identities = {
            (device.address, one.register): bytes((value_of(one, device.kind),)) for one in device.identities()
        }
        for (address, register), data in {**identities, **emulator.factory_registers()}.items():
            self.write(address, register, data)
        self.read_only, self.written = set(self.registers), set()
        self.answers: dict[int, tuple[float, bytes]] = {}  # {number of the transfer: (time, bytes)}
        transfers = [transfer for one in device.rounds() for transfer in one.transfers]
        self.transfers: dict[int, Transfer] = {transfer.number: transfer for transfer in transfers}
        self.tabled = {place for transfer in transfers for place, _ in self.parts(transfer, b"")}
        self.addresses = {device.address, *device.chips(), *(transfer.address for transfer in transfers)} - {None}

    def write(self, address: int, register: int, data: bytes) -> None:
        """Write consecutive registers. Those that identify the chip keep their bytes."""
        for key, byte in zip(self.keys(address, register, len(data)), data):
            if key not in self.read_only:
                self.registers[key] = byte
                self.written.add(key)

    def read(self, address: int, register: int, count: int) -> bytes | None:
        """Return bytes of consecutive registers; None without an answer of the emulator."""
        place, keys = (address, register, count), self.keys(address, register, count)
        since = time.monotonic() - ANSWER_TIMEOUT
        answers = [
            (self.agreement(parts), when, parts[place])
            for number, (when, data) in self.answers.items()
            if place in (parts := dict(self.parts(self.transfers[number], data))) and when >= since
        ]
        if answers:
            return max(answers)[2]
        if place in self.tabled and not self.written.issuperset(keys):
            return None
        return bytes(self.registers.get(key, 0) for key in keys)

    def agreement(self, parts: dict[tuple[int, int, int], bytes]) -> int:
        """Return the number of bytes of an answer that agree with what has been written."""
        return sum(
            self.registers[key] == byte
            for place, data in parts.items()
            for key, byte in zip(self.keys(*place), data)
            if key in self.written
        )

    def parts(self, transfer: Transfer, data: bytes) -> Iterator[tuple[tuple[int, int, int], bytes]]:
        """Yield ((address, register, count), bytes) of each read of an answer."""
        at, address = 0, self.device.address if transfer.address is None else transfer.address
        for step in transfer.steps:
            if isinstance(step, Read):
                yield (address, step.register, step.count), data[at : at + step.count]
                at += step.count

    def keys(self, address: int, register: int, count: int) -> list[tuple[int, int]]:
        """Return the keys of the bytes of consecutive registers. One register of a wide chip holds two bytes."""
        width = self.device.register_bytes
        return [(address, register * width + k) for k in range(count)]


def value_of(identity: Identity, kind: str) -> int:
    """Return the value of an identity register for a kind of chip."""
    return next((value for value, name in identity.values.items() if name == kind), next(iter(identity.values)))


class I2cServer(SocketServer):
    """Thread that answers the exchanges of a run.

    channel : path of the socket
    pairs : (device of the robot, its emulator) of each device on this bus

    Raises BadInput if the socket cannot be made.
    """

    def __init__(self, channel: Path, pairs: Iterable[tuple[I2cDevice, I2cDevice]]) -> None:
        self.open_masks = dict.fromkeys(range(MUX, MUX + 8), 0)
        self.chips = {(device.place, device.address): EmulatedChip(device, emulator) for device, emulator in pairs}
        self.muxes = {chip.device.mux for chip in self.chips.values() if chip.device.mux}
        super().__init__(channel)

    def take(self) -> None:
        """Keep the newest answers of the emulators."""
        now = time.monotonic()
        for identifier, data, _ in self.lines.take(0):
            chip = self.chips.get((identifier >> 8 & 0xFF, identifier & 0xFF))
            number = identifier >> 16 & 0xF
            if chip is not None and number in chip.transfers:
                chip.answers[number] = now, data

    def serve(self, client: socket.socket) -> None:
        """Answer one request. Raises OSError if the run has disconnected."""
        request = client.recv(PACKET_BYTES)
        if len(request) < REQUEST_HEADER:
            raise ConnectionError
        number, address, reads, registered, register, count = request[:REQUEST_HEADER]
        data = self.exchange(address, register if registered else -1, request[REQUEST_HEADER:], count, bool(reads))
        status = errno.EREMOTEIO if data is None else 0
        client.send(bytes((number, status)) + (data or b""))

    def exchange(self, address: int, register: int, data: bytes, count: int, reads: bool) -> bytes | None:
        """Return the bytes of an exchange, none of a write; None without an acknowledge. register : -1 for none"""
        if address in self.muxes:
            if not reads and data:
                self.open_masks[address] = data[-1]
            return bytes((self.open_masks[address],)) if reads else b""
        for chip in self.chips.values():
            if address in chip.addresses and self.is_connected(chip.device.place):
                if register < 0:
                    return bytes(count) if reads else b""
                if reads:
                    return chip.read(address, register, count)
                chip.write(address, register, data)
                return b""
        return None

    def is_connected(self, place: int) -> bool:
        """Return whether a bus segment is connected: the bus itself, or an open channel of a multiplexer."""
        mux, channel = divmod(place - 1, CHANNELS)
        return place == 0 or bool(self.open_masks[MUX + mux] >> channel & 1)
