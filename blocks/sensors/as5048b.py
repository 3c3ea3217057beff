"""AS5048B, a magnetic encoder of 14 bits on I2C. (ams, AS5048A/AS5048B v1-11)"""

from __future__ import annotations

from typing import Any

from blocks.i2c import I2cDevice, Read
from blocks.sensors.magnetic_encoder import EmulatedEncoder, MagneticEncoder
from cext.kernels.devices import encoders as kernels
from graph import Param

DIAGNOSTICS = 0xFB  # followed by the magnitude and the angle


class AS5048B(MagneticEncoder, I2cDevice):
    """AS5048B, a magnetic encoder of a joint: θ = ± 2π counts / 16384 − offset, within ±π.

    `counts` are relative to a zero position that is programmed in the chip. An angle with an overflow, or before the
    offset is compensated, is not a sample.   (ams, AS5048A/AS5048B v1-11)
    """

    address = Param(
        0x40, "1", "address: 0x40 to 0x43, selected by A1 and A2", min=0x08, max=0x77, fixed=True, kernel=False
    )

    kind, known_addresses = "AS5048B", (0x40, 0x41, 0x42, 0x43)
    codes, sample = 16384, Read(DIAGNOSTICS, 5)
    decode = kernels.as5048b_decode

    hardware = (*I2cDevice.hardware, "invert", "offset")

    def emulator(self, **parameters: Any) -> EmulatedAS5048B:
        return EmulatedAS5048B.of(self, **parameters)


class EmulatedAS5048B(EmulatedEncoder, I2cDevice):
    """Emulated AS5048B."""

    address = AS5048B.parameters["address"]
    kind, known_addresses = AS5048B.kind, AS5048B.known_addresses
    encode = kernels.as5048b_answers
