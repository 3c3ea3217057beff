"""Devices that the native thread of a bus reads (cext/lines/i2c.pyx): the common part of I2C and SPI."""

from __future__ import annotations

from typing import Any

from cext.kernels import no_io
from graph import Device

EXTENDED_ID = True


class ChipDevice(Device):
    """Device whose replies a native thread reads, each as a frame (cext/lines/i2c_answers.pxd)."""

    abstract = True
    kind = ""  # name of the chip
    address: Any  # number of the chip on its bus segment
    encode = no_io.send_nothing

    @property
    def place(self) -> int:
        """Number of the bus segment, as in the frame identifiers: 0 for the bus itself."""
        return 0

    def own_identity(self) -> int:
        """Return the identifier of its frames: number of the bus segment and address."""
        return self.place << 8 | self.address

    def rounds(self) -> Any:
        """Return every Round."""
        return ()
