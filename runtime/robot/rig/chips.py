"""Chips of an I2C bus, through multiplexers, with smbus2: for set-up and for listing."""

from __future__ import annotations

import errno
from contextlib import suppress
from typing import TYPE_CHECKING

from blocks.families import families
from blocks.i2c import CHANNELS, MUX

if TYPE_CHECKING:
    from collections.abc import Iterable
    from types import TracebackType

    from smbus2 import SMBus

    from cext.lines.i2c import I2cAdapter

FIRST, LAST = 0x08, 0x77  # range of device addresses
# memories: probed by reading a byte, since a write without data could damage their content
FRAGILE = {*range(0x30, 0x38), *range(0x50, 0x60)}


class NoAnswer(Exception):
    """No acknowledge from an address. error : OSError; address : that of the chip; mux : whether it is a multiplexer"""

    def __init__(self, error: OSError, address: int, mux: bool = False) -> None:
        super().__init__(f"{address:#04x}: {error}")
        self.errno, self.address, self.mux = error.errno, address, mux


class Chips:
    """I2C chips behind multiplexers. wires : smbus2.SMBus, or an object with its methods"""

    def __init__(self, wires: SMBus | AdapterWires) -> None:
        self.wires = wires
        self.open = (0, 0)  # multiplexer and channel that this object has opened; 0: none

    def close(self) -> None:
        """Close the adapter of the bus."""
        self.wires.close()

    def read(self, address: int, register: int, count: int) -> bytes:
        """Return `count` bytes from a register. Raises NoAnswer.

        An adapter without block transfers reads a word, two bytes on the bus, for two bytes.
        """
        with answered(address):
            if count == 1:
                return bytes((self.wires.read_byte_data(address, register),))
            if count == 2:
                return self.wires.read_word_data(address, register).to_bytes(2, "little")
            return bytes(self.wires.read_i2c_block_data(address, register, count))

    def write(self, address: int, register: int, data: bytes) -> None:
        """Write bytes to a register. Raises NoAnswer."""
        with answered(address):
            if len(data) == 1:
                self.wires.write_byte_data(address, register, data[0])
            elif len(data) == 2:
                self.wires.write_word_data(address, register, int.from_bytes(data, "little"))
            else:
                self.wires.write_i2c_block_data(address, register, list(data))

    def probe(self, address: int) -> None:
        """Raise NoAnswer if no device acknowledges an address."""
        with answered(address):
            if address in FRAGILE:
                self.wires.read_byte(address)
                return
            try:
                self.wires.write_quick(address)
            except OSError as error:
                if error.errno != errno.EOPNOTSUPP:
                    raise
                self.wires.read_byte(address)

    def switch(self, mux: int, channel: int) -> None:
        """Open one channel only, and close that of another multiplexer. Raises NoAnswer.

        mux : address of the multiplexer, 0 to close all
        channel : 0 to 7
        """
        if self.open == (mux, channel):
            return
        if self.open[0] and self.open[0] != mux:
            self.select(self.open[0], 0)
        self.open = (0, 0)
        if mux:
            self.select(mux, 1 << channel)
            self.open = (mux, channel)

    def select(self, mux: int, mask: int) -> None:
        """Write the mask of open channels to a multiplexer. Raises NoAnswer."""
        try:
            with answered(mux):
                self.wires.write_byte(mux, mask)
        except NoAnswer as error:
            error.mux = True
            raise

    def leave(self) -> None:
        """Close the open channel."""
        self.switch(0, 0)

    def answering(self, outside: bool = False) -> list[int]:
        """Return the responding addresses on the open channel and the bus. outside : close all channels before"""
        if outside:
            with suppress(NoAnswer):
                self.switch(0, 0)
        addresses = []
        for address in range(FIRST, LAST + 1):
            try:
                self.probe(address)
                addresses.append(address)
            except NoAnswer as error:
                if error.errno == errno.EBUSY:  # used by a kernel driver
                    addresses.append(address)
                elif error.errno in (errno.ETIMEDOUT, errno.EAGAIN):
                    break  # each address of a stuck bus would take seconds
        return addresses


class answered:
    """Context manager that converts an OSError to NoAnswer."""

    def __init__(self, address: int) -> None:
        self.address = address

    def __enter__(self):
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, OSError):
            raise NoAnswer(error, self.address) from None


class AdapterWires:
    """Methods of smbus2.SMBus for an adapter that is no /dev/i2c-*. All raise OSError without an acknowledge."""

    def __init__(self, adapter: I2cAdapter) -> None:
        self.adapter = adapter

    def close(self) -> None:
        """Leave the adapter open: its owner closes it."""

    def write_quick(self, address: int) -> None:
        """Address a device without data."""
        self.adapter.exchange_bytes(address, -1, b"")

    def read_byte(self, address: int) -> int:
        """Read one byte, without a register."""
        return self.adapter.exchange_bytes(address, -1, count=1)[0]

    def write_byte(self, address: int, value: int) -> None:
        """Write one byte, without a register."""
        self.adapter.exchange_bytes(address, -1, bytes((value,)))

    def read_byte_data(self, address: int, register: int) -> int:
        """Read one byte of a register."""
        return self.adapter.exchange_bytes(address, register, count=1)[0]

    def write_byte_data(self, address: int, register: int, value: int) -> None:
        """Write one byte to a register."""
        self.adapter.exchange_bytes(address, register, bytes((value,)))

    def read_word_data(self, address: int, register: int) -> int:
        """Read two bytes, least significant first."""
        return int.from_bytes(self.adapter.exchange_bytes(address, register, count=2), "little")

    def write_word_data(self, address: int, register: int, value: int) -> None:
        """Write two bytes, least significant first."""
        self.adapter.exchange_bytes(address, register, value.to_bytes(2, "little"))

    def read_i2c_block_data(self, address: int, register: int, length: int) -> list[int]:
        """Read `length` bytes from a register on."""
        return list(self.adapter.exchange_bytes(address, register, count=length))

    def write_i2c_block_data(self, address: int, register: int, data: Iterable[int]) -> None:
        """Write bytes from a register on."""
        self.adapter.exchange_bytes(address, register, bytes(data))


class KnownChips:
    """Identification of chips by their registers. chips : Chips"""

    def __init__(self, chips: Chips) -> None:
        self.chips = chips
        self.registers, self.guesses = {}, {}  # by address: [(register, {value: name}, mask)], and names
        for chip in (chip for family in families() for chip in family.chips):
            for address in chip.addresses:
                if chip.registers:
                    self.registers.setdefault(address, []).append(chip.registers)
                else:
                    self.guesses[address] = chip.name
        self.guesses |= {address: "TCA9548A multiplexer" for address in range(MUX, MUX + 8)}

    def name(self, address: int) -> tuple[str, str]:
        """Return (name, evidence) of the chip at an address on the open channel: "" twice for an unknown chip."""
        read = {}
        for register, values, mask in self.registers.get(address, ()):
            if register not in read:
                try:
                    read[register] = self.chips.read(address, register, 1)[0]
                except NoAnswer:
                    return "", ""
            value = read[register]
            if value & mask in values:
                return values[value & mask], f"register {register:#04x} is {value:#04x}"
        return (self.guesses[address], "by its address") if address in self.guesses else ("", "")

    def everywhere(self) -> list[tuple[int, int, int, str, str]]:
        """Return all chips as [(mux, channel, address, name, evidence)]; mux is 0 on the bus itself.

        Chips on the bus itself are listed once.
        """
        self.chips.leave()
        on_bus = self.chips.answering()
        muxes = [address for address in on_bus if MUX <= address < MUX + 8]
        for mux in muxes:
            self.chips.select(mux, 0)  # a previous run may have left channels open
        on_bus = [address for address in self.chips.answering()]
        chips = [(0, 0, address, *self.name(address)) for address in on_bus]
        for mux in muxes:
            for channel in range(CHANNELS):
                try:
                    self.chips.switch(mux, channel)
                except NoAnswer:
                    break
                chips += [
                    (mux, channel, address, *self.name(address))
                    for address in self.chips.answering()
                    if address not in on_bus
                ]
        self.chips.leave()
        return chips


def in_hex(addresses: Iterable[int]) -> str:
    """Return addresses as text: '0x48, 0x68', or 'none'."""
    return ", ".join(f"{address:#04x}" for address in addresses) or "none"
