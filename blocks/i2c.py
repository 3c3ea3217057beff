"""Devices on I2C: location, configuration, and the table of periodic reads.

A thread of the bus executes the table (cext/lines/i2c.pyx); each reply becomes a frame (cext/lines/i2c_answers.pxd).
"""

from collections.abc import Callable
from typing import Any

from msgspec import Struct

from blocks._plumbing.timeouts import timeout_param
from blocks.chips import EXTENDED_ID, ChipDevice
from graph import Param

MUX, CHANNELS = 0x70, 8  # lowest address and number of channels of a TCA9548A


class Write(Struct, frozen=True):
    """Write of bytes to consecutive registers.

    register : first register
    wait : s without access to the device afterwards
    address : address of another chip inside the device, or None
    """

    register: int
    data: bytes
    wait: float = 0.0
    address: int | None = None


class Read(Struct, frozen=True):
    """Read of `count` bytes from consecutive registers, starting at `register`."""

    register: int
    count: int


class Transfer(Struct, frozen=True):
    """Combined transfer. Its reply is a frame: all bytes read, followed by `appended`.

    number : number below 15, part of the frame's identifier
    steps : sequence of Read and Write, or on SPI one Shift (blocks.spi)
    address : address of another chip inside the device, or None
    """

    number: int
    steps: tuple[Any, ...]
    appended: bytes = b""
    address: int | None = None


class Round(Struct, frozen=True):
    """Periodic sequence of transfers, one per period.

    period : s
    settle : minimum time in s between transfers, if the device needs it
    """

    period: float
    transfers: tuple[Transfer, ...]
    settle: float = 0.0


class Identity(Struct, frozen=True):
    """Identification register of a chip. values : {byte: name}, compared under the mask"""

    register: int
    values: dict[int, str]
    mask: int = 0xFF


class I2cDevice(ChipDevice):
    """Device on an I2C bus, directly or behind a multiplexer."""

    abstract = True
    medium = "i2c"
    register_bytes = 1  # bytes of one register
    known_addresses = ()  # selectable with its pins
    address_hint = (
        "each chip on a bus segment needs a unique address: select another with its pins, or connect one "
        "behind a multiplexer"
    )

    bus = Param("i2c", "1", "logical name of the I2C bus", dtype=str)
    address = Param(0x08, "1", "7-bit address", min=0x08, max=0x77, fixed=True, kernel=False)
    mux = Param(
        0,
        "1",
        "address of the TCA9548A multiplexer in front of the device, 0x70 to 0x77; 0 for none",
        min=0,
        max=0x77,
        fixed=True,
        kernel=False,
    )
    channel = Param(0, "1", "channel of the multiplexer", min=0, max=CHANNELS - 1, fixed=True, kernel=False)
    timeout = timeout_param()

    hardware = ("address", "mux", "channel")

    def configure(self) -> None:
        if self.known_addresses and self.address not in self.known_addresses:
            raise ValueError(
                f"address {self.address:#04x}: the addresses of a {self.kind} are "
                f"{addresses_in_words(self.known_addresses)}"
            )
        if self.mux and not MUX <= self.mux < MUX + 8:
            raise ValueError(
                f"mux {self.mux:#04x}: the addresses of a TCA9548A are 0x70 to 0x77, and 0 means no multiplexer"
            )
        if self.channel and not self.mux:
            raise ValueError("channel requires a multiplexer. Set its address, such as mux=0x70")

    @property
    def place(self) -> int:
        """Number of the bus segment, as in the frame identifiers: 0 in front of all multiplexers."""
        return 1 + CHANNELS * (self.mux - MUX) + self.channel if self.mux else 0

    def chips(self) -> tuple[int, ...]:
        """Return the addresses that the device uses on its bus segment."""
        return (self.address,)

    def addresses(self) -> list[tuple[int, bool]]:
        """Return (identifier, is extended) of every address that the device occupies.

        A device in front of the multiplexers also occupies its address on every channel behind them.
        """
        places = [self.place] if self.mux else range(1 + CHANNELS * 8)
        return [(place << 8 | address, EXTENDED_ID) for address in self.chips() for place in places]

    def displayed_addresses(self) -> Any:
        return [f"{self.mux:#04x}.{self.channel} {self.address:#04x}" if self.mux else f"{self.address:#04x}"]

    def address_in_words(self, address: tuple[int, bool]) -> str:
        return f"I2C address {address[0] & 0xFF:#04x}"

    # Configuration and reads, for the thread of the bus

    def identities(self) -> tuple[Any, ...]:
        """Return an Identity per identifiable chip, to be checked before the configuration."""
        return ()

    def release(self) -> tuple[Any, ...]:
        """Return the Writes that disconnect internal chips with shared addresses from the bus.

        They precede the configuration of every device on the bus.
        """
        return ()

    def set_up(self) -> Any:
        """Return the Writes that configure the device from any state."""
        return ()

    def learn(self, read: Callable[..., Any], write: Callable[..., Any]) -> None:
        """Read the values that `rounds` needs, after the configuration. ValueError if they are invalid.

        read(register, count, address=None) -> bytes, write(Write)
        """

    def check(self) -> tuple[int, bytes] | None:
        """Return (register, bytes) that confirm the configuration.

        None for a device that cannot lose its configuration undetected.
        """
        return None

    def factory_registers(self) -> dict[tuple[int, int], bytes]:
        """Return {(address, register): bytes} of an emulated chip after power-on; the other registers are 0."""
        return {}


def addresses_in_words(addresses: tuple[int, ...]) -> str:
    """Return addresses as text, in hexadecimal."""
    return ", ".join(f"{address:#04x}" for address in addresses)
