"""AS5600, a magnetic encoder of 12 bits on I2C. (ams, AS5600 v1-06)"""

from __future__ import annotations

from typing import Any

from blocks.i2c import I2cDevice, Read
from blocks.sensors.magnetic_encoder import EmulatedEncoder, MagneticEncoder
from cext.kernels.devices import encoders as kernels
from graph import Param

STATUS = 0x0B  # followed by RAW ANGLE, which the settings of the chip do not change


class AS5600(MagneticEncoder, I2cDevice):
    """AS5600, a magnetic encoder of a joint: θ = ± 2π counts / 4096 − offset, within ±π.

    Its filter, hysteresis and power mode stay as they are set in the chip: none, and the slowest filter, as delivered.
    An angle without a magnet is not a sample.   (ams, AS5600 v1-06)
    """

    address = Param(0x36, "1", "address, always 0x36", min=0x08, max=0x77, fixed=True, kernel=False)

    kind, known_addresses = "AS5600", (0x36,)
    codes, sample = 4096, Read(STATUS, 3)
    decode = kernels.as5600_decode

    hardware = (*I2cDevice.hardware, "invert", "offset")

    def emulator(self, **parameters: Any) -> EmulatedAS5600:
        return EmulatedAS5600.of(self, **parameters)


class EmulatedAS5600(EmulatedEncoder, I2cDevice):
    """Emulated AS5600."""

    address = AS5600.parameters["address"]
    kind, known_addresses = AS5600.kind, AS5600.known_addresses
    encode = kernels.as5600_answers
