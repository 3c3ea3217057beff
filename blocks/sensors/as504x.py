"""AS5047 and AS5048A, magnetic encoders of 14 bits on SPI. (ams, AS5047P, AS5047D, AS5048)

Frames have 16 bits: even parity in bit 15, bit 14 is 1 for a read command and for an error in a reply, then the address
or the data. The reply to a command arrives in the next frame. One transfer reads the angle, then the diagnostics, which
are thus not older than the angle, then the error register, which clears it. It receives the error register of the
transfer before, the angle and the diagnostics. A reply with a wrong parity or an error bit is not a sample.
"""

from __future__ import annotations

from typing import Any

from blocks.sensors.magnetic_encoder import EmulatedEncoder, MagneticEncoder
from blocks.spi import Shift, SpiDevice
from cext.kernels.devices import encoders as kernels
from graph import Input, Memory, Output, Param

ERROR_REGISTER, ANGLE, UNCOMPENSATED = 0x0001, 0x3FFF, 0x3FFE
READ = ERROR = 0x4000
FRAMING, COMMAND, PARITY = 1, 2, 4  # bits of the error register
DATA = 0x3FFF


def with_parity(bits: int) -> int:
    """Return a frame of 16 bits with even parity. bits : the lower 15"""
    return bits | (bits.bit_count() & 1) << 15


def words(data: bytes) -> list[int]:
    """Return the frames in bytes."""
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]


class SpiEncoder(MagneticEncoder, SpiDevice):
    """Magnetic encoder of 14 bits on SPI."""

    abstract = True
    mode, codes = 1, 16384
    diagnostics: int  # register
    decode = kernels.as504x_decode

    errors = Output("1", "failed transfers and refused replies since the start of the run", dtype=int)

    refused = Memory(0.0, "replies with a wrong parity or an error bit")

    hardware = (*SpiDevice.hardware, "invert", "offset")

    @property
    def angle_register(self) -> int:
        """Register of the angle."""
        return ANGLE

    @property
    def sample(self) -> Shift:
        """Commands that read one sample."""
        registers = (self.angle_register, self.diagnostics, ERROR_REGISTER)
        return Shift(b"".join(with_parity(READ | register).to_bytes(2, "big") for register in registers), 2)

    def problem(self, reply: bytes) -> str:
        for word in words(reply):
            if word.bit_count() & 1:
                return f"its reply {reply.hex(' ')} has a wrong parity"
            if word & ERROR:
                return f"its reply {reply.hex(' ')} has an error bit" + (
                    ", as an input without a chip reads" if set(reply) == {0xFF} else ""
                )
        return "it replies 0 only, as without a supply" if not any(reply) else ""

    def chip(self) -> EmulatedRegisters:
        return EmulatedRegisters(self.angle_register, self.diagnostics)


class EmulatedRegisters:
    """Registers and frames of an emulated chip on a bus. angle, diagnostics : addresses of its registers"""

    def __init__(self, angle: int, diagnostics: int) -> None:
        self.places = {ERROR_REGISTER: 0, angle: 1, diagnostics: 2}  # of the registers in an answer
        self.reply, self.errors = 0, 0

    def shift(self, sent: bytes, answer: bytes | None) -> bytes:
        """Return the bytes that the chip sends meanwhile; without an answer, those of an input without a chip."""
        if answer is None:
            return b"\xff" * len(sent)
        received = b""
        for command in words(sent):
            received += self.reply.to_bytes(2, "big")
            register = command & DATA
            if command.bit_count() & 1:
                self.errors |= PARITY
            elif not command & READ or register not in self.places:
                self.errors |= COMMAND
            if register == ERROR_REGISTER:
                self.reply, self.errors = with_parity(self.errors), 0
            elif self.errors:
                self.reply = with_parity(ERROR)
            else:
                self.reply = words(answer)[self.places[register]]
        return received


class AS5047(SpiEncoder):
    """AS5047P or AS5047D, a magnetic encoder of a joint: θ = ± 2π counts / 16384 − offset, within ±π.

    `counts` are relative to a zero position that is programmed in the chip. An angle with an overflow, or before the
    offset is compensated, is not a sample.   (ams, AS5047P, AS5047D)
    """

    compensated = Param(
        True, "1", "true reads the angle with dynamic compensation, false without", fixed=True, kernel=False
    )

    kind, diagnostics = "AS5047", 0x3FFC

    @property
    def angle_register(self) -> int:
        return ANGLE if self.compensated else UNCOMPENSATED

    def emulator(self, **parameters: Any) -> EmulatedAS5047:
        return EmulatedAS5047.of(self, **parameters)


class AS5048A(SpiEncoder):
    """AS5048A, a magnetic encoder of a joint: θ = ± 2π counts / 16384 − offset, within ±π.

    `counts` are relative to a zero position that is programmed in the chip. An angle with an overflow, or before the
    offset is compensated, is not a sample.   (ams, AS5048A)
    """

    kind, diagnostics = "AS5048A", 0x3FFD

    def emulator(self, **parameters: Any) -> EmulatedAS5048A:
        return EmulatedAS5048A.of(self, **parameters)


class EmulatedSpiEncoder(EmulatedEncoder, SpiDevice):
    """Emulated magnetic encoder on SPI."""

    abstract = True
    encode = kernels.as504x_answers

    corrupt = Input("1", "true inverts a bit of each angle", default=False, dtype=bool)


class EmulatedAS5047(EmulatedSpiEncoder):
    """Emulated AS5047."""

    kind = AS5047.kind


class EmulatedAS5048A(EmulatedSpiEncoder):
    """Emulated AS5048A."""

    kind = AS5048A.kind
