"""Devices on SPI: chip select, mode, and the table of periodic transfers."""

from __future__ import annotations

from typing import Any

from msgspec import Struct

from blocks._plumbing.timeouts import timeout_param
from blocks.chips import EXTENDED_ID, ChipDevice
from graph import Param


class Shift(Struct, frozen=True):
    """Bytes sent while as many are received.

    word : bytes of a frame; the chip is deselected after each frame
    """

    data: bytes
    word: int


class SpiDevice(ChipDevice):
    """Device on an SPI bus. A step of its transfers is a Shift."""

    abstract = True
    medium = "spi"
    mode = 0  # clock polarity and phase, 0 to 3
    address_hint = "each chip on an SPI bus needs its own chip select"

    bus = Param("spi", "1", "logical name of the SPI bus", dtype=str)
    chip_select = Param(
        0, "1", "number of the chip select, N of /dev/spidev0.N", min=0, max=7, fixed=True, kernel=False
    )
    timeout = timeout_param("valid reply")

    hardware = ("chip_select",)

    @property
    def address(self) -> int:
        """Chip select, as in the frame identifiers."""
        return self.chip_select

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.chip_select, EXTENDED_ID)]

    def displayed_addresses(self) -> list[str]:
        return [f"CS{self.chip_select}"]

    def address_in_words(self, address: tuple[int, bool]) -> str:
        return f"chip select {address[0]}"

    def shifts(self) -> list[tuple[float, int, int]]:
        """Return (transfers per second, bytes, frames) of each of its transfers."""
        return [
            (1.0 / (one.period * len(one.transfers)), len(step.data), len(step.data) // step.word)
            for one in self.rounds()
            for transfer in one.transfers
            for step in transfer.steps
        ]

    def problem(self, reply: bytes) -> str:
        """Return why a reply to the first transfer, sent before a run, is invalid; "" if it is valid."""
        return ""

    def chip(self) -> Any:
        """Return an emulated chip, with the method shift(sent, answer) -> bytes.

        answer : newest bytes of its emulator, or None
        """
        raise NotImplementedError
