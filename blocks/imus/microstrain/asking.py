"""Who a MicroStrain sensor is, as it tells when it is asked."""

import struct
from dataclasses import dataclass

TEXT = 16  # characters of each, right-justified


@dataclass(frozen=True)
class Information:
    """firmware as the vendor writes it, model, number, serial, lot, options: texts"""

    firmware: str
    model: str
    number: str
    serial: str
    lot: str
    options: str

    @classmethod
    def of(cls, data):
        """From the data of field 01 81. ValueError"""
        if len(data) < 2 + 5 * TEXT:
            raise ValueError(f"a device information has {2 + 5 * TEXT} bytes, not {len(data)}")
        [firmware] = struct.unpack_from(">H", data)
        texts = (data[at : at + TEXT].decode("ascii", "replace").strip(" \0") for at in range(2, 2 + 5 * TEXT, TEXT))
        return cls(f"{firmware // 1000}.{firmware % 1000 // 100}.{firmware % 100}", *texts)

    def ends_with(self, digits):
        """Whether its serial number ends so: 133931 is that of 6253.133931."""
        return bool(digits) and self.serial.endswith(digits)
