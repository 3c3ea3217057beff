"""Devices on I2C: where they sit, what is written to set them up, and the table of what is read from them.

A thread of the bus carries the table out (cext/lines/i2c.pyx); each answer becomes a frame
(cext/lines/i2c_answers.pxd).
"""

from dataclasses import dataclass

from cext.kernels import no_io
from graph import Device, Param

MUX, CHANNELS = 0x70, 8  # lowest address of a TCA9548A, and how many buses each makes
EXTENDED_ID = True


@dataclass(frozen=True)
class Write:
    """Bytes written from a register on. wait : s for which the device is left alone afterwards; address : another chip
    inside the device
    """

    register: int
    data: bytes
    wait: float = 0.0
    address: int | None = None


@dataclass(frozen=True)
class Read:
    """So many bytes from a register on."""

    register: int
    count: int


@dataclass(frozen=True)
class Transfer:
    """What is asked at once. Its answer is a frame: all bytes read, then those `appended`.

    number : below 15, part of the frame's identifier
    steps : of Read and Write
    address : of another chip inside the device
    """

    number: int
    steps: tuple
    appended: bytes = b""
    address: int | None = None


@dataclass(frozen=True)
class Round:
    """Transfers one after the other, one in each period.

    period : s
    settle : s at least from one to the next, where the device needs that time
    """

    period: float
    transfers: tuple
    settle: float = 0.0


@dataclass(frozen=True)
class Identity:
    """What the register of a chip holds that says what it is. values : {byte: name}, of the bits where the mask is 1"""

    register: int
    values: dict
    mask: int = 0xFF


class I2cDevice(Device):
    """A device on an I2C bus, or behind a multiplexer on it."""

    abstract = True
    medium = "i2c"
    kind = ""  # what it is, in words
    known_addresses = ()  # that its pins can choose
    address_hint = (
        "each chip on a piece of bus has an address of its own: choose another with its pins, or put one "
        "behind a multiplexer"
    )
    encode = no_io.send_nothing

    bus = Param("i2c", "1", "logical name of its I2C bus", dtype=str)
    address = Param(0x08, "1", "its address, of seven bits", min=0x08, max=0x77, fixed=True, kernel=False)
    mux = Param(
        0,
        "1",
        "address of the multiplexer TCA9548A that it is behind, 0x70 to 0x77; 0 for none",
        min=0,
        max=0x77,
        fixed=True,
        kernel=False,
    )
    channel = Param(0, "1", "of that multiplexer", min=0, max=CHANNELS - 1, fixed=True, kernel=False)
    timeout = Param(
        0.1, "s", "of silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True, kernel=False
    )

    hardware = ("address", "mux", "channel")

    def configure(self):
        if self.known_addresses and self.address not in self.known_addresses:
            raise ValueError(f"address {self.address:#04x}: a {self.kind} has {listed(self.known_addresses)}")
        if self.mux and not MUX <= self.mux < MUX + 8:
            raise ValueError(f"mux {self.mux:#04x}: a TCA9548A has 0x70 to 0x77; 0 for none")
        if self.channel and not self.mux:
            raise ValueError("channel is that of a multiplexer: say which one with mux=0x70")

    @property
    def place(self):
        """Number of the piece of bus that it is on, as its frames have it."""
        return 1 + CHANNELS * (self.mux - MUX) + self.channel if self.mux else 0

    def own_identity(self):
        return self.place << 8 | self.address

    def chips(self):
        """Addresses that it takes on its piece of bus."""
        return (self.address,)

    def addresses(self):
        """What is on the bus itself is heard behind every multiplexer too: nobody there may have its address."""
        places = [self.place] if self.mux else range(1 + CHANNELS * 8)
        return [(place << 8 | address, EXTENDED_ID) for address in self.chips() for place in places]

    def told_addresses(self):
        return [f"{self.mux:#04x}.{self.channel} {self.address:#04x}" if self.mux else f"{self.address:#04x}"]

    def address_in_words(self, address):
        return f"I2C address {address[0] & 0xFF:#04x}"

    # What the thread of the bus and the set-up are told

    def identities(self):
        """Identity of each chip that tells what it is, to be read before it is set up."""
        return ()

    def release(self):
        """Write by Write, before any device of the bus is set up: chips inside it that others have too leave the
        bus.
        """
        return ()

    def set_up(self):
        """Write by Write, from whatever state it is in."""
        return ()

    def learn(self, read, write):
        """Ask it, once it is set up, what `rounds` has to know of it. ValueError, in words, if that is wrong.

        read(register, count, address=None) -> bytes, write(Write)
        """

    def check(self):
        """(register, bytes) by which it shows that it is still set up; None for a device that cannot lose that
        unseen.
        """
        return None

    def rounds(self):
        """Every Round."""
        return ()


def listed(addresses):
    """Return addresses as text, in hexadecimal."""
    return ", ".join(f"{address:#04x}" for address in addresses)
