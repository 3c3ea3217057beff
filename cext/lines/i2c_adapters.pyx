# cython: freethreading_compatible=True
"""I2C adapter of Linux, such as /dev/i2c-1, with one ioctl per exchange.

    combined    I2C_RDWR: writes the register, then reads the answer with a repeated start. One read per call, at its
                end: the limit of the Raspberry Pi's adapter
    SMBus       for adapters without such transfers: a byte, a word or a block of up to 32 bytes, identical on the wire
"""

import errno
import fcntl
import os

from libc.errno cimport EINTR, ENXIO, errno as failed_with
from libc.stdint cimport uint8_t, uint16_t, uint32_t, uint64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset
from posix.unistd cimport close

from cext.lines.i2c cimport I2cAdapter

cdef extern from "<sys/ioctl.h>" nogil:
    int ioctl(int fd, unsigned long request, ...)

cdef extern from "<linux/i2c.h>" nogil:
    cdef struct i2c_msg:
        uint16_t addr
        uint16_t flags
        uint16_t len
        uint8_t *buf
    cdef union i2c_smbus_data:
        uint8_t byte
        uint16_t word
        uint8_t block[34]
    const int I2C_M_RD, I2C_SMBUS_READ, I2C_SMBUS_WRITE
    const int I2C_SMBUS_BYTE, I2C_SMBUS_BYTE_DATA, I2C_SMBUS_WORD_DATA, I2C_SMBUS_I2C_BLOCK_DATA
    const unsigned long I2C_FUNC_I2C, I2C_FUNC_SMBUS_BYTE_DATA
    const unsigned long I2C_FUNC_SMBUS_READ_I2C_BLOCK, I2C_FUNC_SMBUS_WRITE_I2C_BLOCK

cdef extern from "<linux/i2c-dev.h>" nogil:
    cdef struct i2c_rdwr_ioctl_data:
        i2c_msg *msgs
        uint32_t nmsgs
    cdef struct i2c_smbus_ioctl_data:
        uint8_t read_write
        uint8_t command
        uint32_t size
        i2c_smbus_data *data
    const unsigned long I2C_RETRIES, I2C_TIMEOUT, I2C_SLAVE, I2C_FUNCS, I2C_RDWR, I2C_SMBUS

cdef enum:
    # time-out of an exchange in units of 10 ms: a chip may stretch the clock for some ms
    TENS_OF_MS = 3
    SMBUS_BLOCK_LIMIT = 32

cdef struct Wire:
    int fd
    int slave                           # address that the descriptor is set to, -1 for none


cdef int combined(void *context, uint8_t address, int register, bint reads, uint8_t *data, int count) noexcept nogil:
    cdef Wire *wire = <Wire *>context
    cdef uint8_t[SMBUS_BLOCK_LIMIT + 1] written
    cdef i2c_msg[2] messages
    cdef i2c_rdwr_ioctl_data transfer
    cdef int length = 0
    if register >= 0:
        written[0] = <uint8_t>register
        length = 1
    if not reads:
        memcpy(&written[length], data, count)
        length += count
    messages[0].addr, messages[0].flags, messages[0].len, messages[0].buf = address, 0, <uint16_t>length, written
    messages[1].addr, messages[1].flags = address, <uint16_t>I2C_M_RD
    messages[1].len, messages[1].buf = <uint16_t>count, data
    transfer.msgs, transfer.nmsgs = messages, 2 if reads else 1
    while ioctl(wire.fd, I2C_RDWR, &transfer) < 0:
        if failed_with != EINTR:
            return failed_with
    return 0


cdef int by_smbus(void *context, uint8_t address, int register, bint reads, uint8_t *data, int count) noexcept nogil:
    cdef Wire *wire = <Wire *>context
    cdef i2c_smbus_ioctl_data call
    cdef i2c_smbus_data value
    if wire.slave != address:
        if ioctl(wire.fd, I2C_SLAVE, <unsigned long>address) < 0:
            return failed_with
        wire.slave = address
    memset(&value, 0, sizeof(value))
    call.read_write = I2C_SMBUS_READ if reads else I2C_SMBUS_WRITE
    call.command, call.data = <uint8_t>register, &value
    if register < 0:
        call.command, call.size, call.data = data[0], I2C_SMBUS_BYTE, NULL
    elif count == 1:
        call.size, value.byte = I2C_SMBUS_BYTE_DATA, data[0]
    elif count == 2:
        call.size, value.word = I2C_SMBUS_WORD_DATA, <uint16_t>(data[0] | data[1] << 8)
    else:
        call.size, value.block[0] = I2C_SMBUS_I2C_BLOCK_DATA, <uint8_t>count
        if not reads:
            memcpy(&value.block[1], data, count)
    while ioctl(wire.fd, I2C_SMBUS, &call) < 0:
        if failed_with != EINTR:
            return failed_with
    if not reads:
        return 0
    if count == 1:
        data[0] = value.byte
    elif count == 2:
        data[0], data[1] = <uint8_t>(value.word & 0xFF), <uint8_t>(value.word >> 8)
    else:
        if value.block[0] != count:
            return ENXIO
        memcpy(data, &value.block[1], count)
    return 0


cdef class LinuxAdapter(I2cAdapter):
    """Adapter of a file descriptor, which it duplicates: the caller closes its own. Raises OSError if it is unsuitable.

    combined : whether it has combined transfers
    """

    cdef Wire wire
    cdef readonly bint combined

    def __cinit__(self, int fd):
        cdef unsigned long functions = 0
        cdef unsigned long needed = (
            I2C_FUNC_SMBUS_BYTE_DATA | I2C_FUNC_SMBUS_READ_I2C_BLOCK | I2C_FUNC_SMBUS_WRITE_I2C_BLOCK)
        self.wire.fd, self.wire.slave = -1, -1
        if ioctl(fd, I2C_FUNCS, &functions) < 0:
            raise OSError(failed_with, os.strerror(failed_with))
        self.combined = functions & I2C_FUNC_I2C != 0
        if not self.combined and functions & needed != needed:
            raise OSError(errno.EOPNOTSUPP, "the adapter supports neither combined transfers nor SMBus blocks")
        self.wire.fd = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 3)
        # time-out of the adapter, for all its users; not supported by all
        ioctl(self.wire.fd, I2C_TIMEOUT, <unsigned long>TENS_OF_MS)
        ioctl(self.wire.fd, I2C_RETRIES, <unsigned long>0)
        self.adapter.exchange = combined if self.combined else by_smbus
        self.adapter.context = &self.wire

    def __dealloc__(self):
        if self.wire.fd >= 0:
            close(self.wire.fd)
