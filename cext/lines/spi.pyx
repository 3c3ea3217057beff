# cython: freethreading_compatible=True
"""SPI adapter of Linux: the files of one bus, such as /dev/spidev0.0 and /dev/spidev0.1, with one ioctl per transfer.

The chip is deselected between the frames of a transfer, for the time that its driver needs, 10 µs by default. It is the
adapter of cext.lines.i2c, whose thread reads the chips: the address is the chip select, the register the number of
bytes of a frame.
"""

import fcntl
import os

from libc.errno cimport EINTR, EINVAL, ENODEV, errno as failed_with
from libc.stdint cimport uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memset
from posix.unistd cimport close

from cext.lines.i2c cimport BYTES, I2cAdapter

cdef extern from "<sys/ioctl.h>" nogil:
    int ioctl(int fd, unsigned long request, ...)

cdef extern from "<linux/spi/spidev.h>" nogil:
    cdef struct spi_ioc_transfer:
        uint64_t tx_buf
        uint64_t rx_buf
        uint32_t len
        uint32_t speed_hz
        uint8_t bits_per_word
        uint8_t cs_change
    unsigned long SPI_IOC_MESSAGE(int count)
    const unsigned long SPI_IOC_WR_MODE

cdef enum:
    CHIPS = 8                   # chip selects of a bus

cdef struct Wires:
    int fd[CHIPS]               # -1 for none
    uint32_t clock              # Hz


cdef int shift(void *context, uint8_t address, int word, bint reads, uint8_t *data, int count) noexcept nogil:
    cdef Wires *wires = <Wires *>context
    cdef spi_ioc_transfer[BYTES] frames
    cdef int index
    cdef int number = count // word if word > 0 else 0
    if address >= CHIPS or wires.fd[address] < 0:
        return ENODEV
    if not 0 < number <= BYTES:
        return EINVAL
    memset(frames, 0, sizeof(frames))
    for index in range(number):
        frames[index].tx_buf = frames[index].rx_buf = <uint64_t><size_t>(data + index * word)
        frames[index].len, frames[index].speed_hz, frames[index].bits_per_word = <uint32_t>word, wires.clock, 8
        frames[index].cs_change = index < number - 1
    while ioctl(wires.fd[address], SPI_IOC_MESSAGE(number), frames) < 0:
        if failed_with != EINTR:
            return failed_with
    return 0


cdef class SpiAdapter(I2cAdapter):
    """Adapter of one bus. clock : Hz"""

    cdef Wires wires

    def __cinit__(self, int clock):
        cdef int index
        for index in range(CHIPS):
            self.wires.fd[index] = -1
        self.wires.clock = <uint32_t>clock
        self.adapter.exchange, self.adapter.context = shift, &self.wires

    def add(self, int chip_select, int fd, int mode) -> None:
        """Add a chip. The descriptor of its file is duplicated: the caller closes its own.

        mode : clock polarity and phase, 0 to 3. Raises OSError if the controller does not support it.
        """
        cdef uint8_t wanted = <uint8_t>mode
        if not 0 <= chip_select < CHIPS or self.wires.fd[chip_select] >= 0:
            raise ValueError("invalid chip select %d" % chip_select)
        if ioctl(fd, SPI_IOC_WR_MODE, &wanted) < 0:
            raise OSError(failed_with, os.strerror(failed_with))
        self.wires.fd[chip_select] = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 3)

    def __dealloc__(self):
        cdef int index
        for index in range(CHIPS):
            if self.wires.fd[index] >= 0:
                close(self.wires.fd[index])
