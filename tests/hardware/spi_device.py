"""A file of spidev in user space, /dev/spidev7.0, with an encoder on its wires.

python -m tests.hardware.spi_device       prints a line when the file exists; at the end of its input, as JSON what
                                          it was asked for
"""

import errno
import json
import os
import struct
import sys
import time

from blocks.sensors.as504x import EmulatedRegisters, with_parity
from tests.hardware.cuse import CharacterDevice, Memory

PATH = "/dev/spidev7.0"
WRITE_MODE, MESSAGE = 0x40016B01, 0x40006B00  # <linux/spi/spidev.h>; the size of a message is in bits 16 to 29
TRANSFER = struct.Struct("=QQIIHBBBBBx")  # struct spi_ioc_transfer
CODE = 0x1234


class Spidev:
    """Calls of the kernel's spidev: a mode, and messages of several transfers."""

    def __init__(self, chip):
        self.chip, self.mode, self.messages, self.last = chip, None, 0, []

    def ioctl(self, number, argument, data, room):
        if number == WRITE_MODE:
            if not data:
                raise Memory(((argument, 1),))
            self.mode = data[0]
            return b""
        if number & ~0x3FFF0000 != MESSAGE:
            raise OSError(errno.ENOTTY, "no such call")
        table = (argument, number >> 16 & 0x3FFF)
        if not data:
            raise Memory((table,))
        transfers = [TRANSFER.unpack_from(data, at) for at in range(0, table[1], TRANSFER.size)]
        if len(data) == table[1]:
            raise Memory(
                (table, *((sent, length) for sent, _, length, *_ in transfers)),
                [(received, length) for _, received, length, *_ in transfers],
            )
        self.messages += 1
        self.last = [[length, speed, bits, select] for _, _, length, speed, _, bits, select, *_ in transfers]
        answer = b"".join(with_parity(word).to_bytes(2, "big") for word in (0, CODE, 0x180))
        return self.chip.shift(data[table[1] :], answer)


def main():
    spidev = Spidev(EmulatedRegisters(0x3FFF, 0x3FFC))
    device = CharacterDevice(PATH.removeprefix("/dev/"), spidev.ioctl)
    deadline = time.monotonic() + 5.0
    while not os.path.exists(PATH):
        assert time.monotonic() < deadline, "the kernel has made no such device"
        time.sleep(0.01)
    print(flush=True)
    device.serve(sys.stdin.fileno())
    print(json.dumps([spidev.mode, spidev.messages, spidev.last]), flush=True)
    device.close()


if __name__ == "__main__":
    main()
