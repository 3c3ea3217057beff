"""Frames of I2C answers, and the encoding of numbers in them.

    identifier   EXTENDED | transfer << 16 | place << 8 | address

The place is 0 on the bus itself, 1 + 8 (mux - 0x70) + channel behind a multiplexer; the address is the device's own of
seven bits, even if another chip in it is read. The transfer TROUBLE is not an answer: it reports the failures of a
device.
"""

from libc.math cimport floor
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t

from cext.abi cimport EXTENDED, Frame

cdef enum:
    # data: whether it is lost, number of failed transfers (four bytes, least significant first)
    TROUBLE = 15


cdef inline int transfer_of(const Frame *frame, uint32_t identity) noexcept nogil:
    """Return the transfer number of a frame; -1 if it is not of the device with this identity, place << 8 | address."""
    if (frame.id & ~<uint32_t>0xF0000) != (<uint32_t>EXTENDED | identity):
        return -1
    return <int>(frame.id >> 16 & 0xF)


cdef inline uint32_t answer_id(uint32_t identity, int transfer) noexcept nogil:
    return <uint32_t>EXTENDED | <uint32_t>transfer << 16 | identity


cdef inline double failures(const Frame *frame) noexcept nogil:
    """Return the number of failed transfers in a TROUBLE frame of five bytes."""
    return <double>(
        <uint32_t>frame.data[1] | <uint32_t>frame.data[2] << 8 | <uint32_t>frame.data[3] << 16
        | <uint32_t>frame.data[4] << 24)


cdef inline int16_t big(const uint8_t *data) noexcept nogil:
    """Decode two's complement, most significant byte first."""
    return <int16_t>(<uint32_t>data[0] << 8 | data[1])


cdef inline int16_t little(const uint8_t *data) noexcept nogil:
    return <int16_t>(<uint32_t>data[1] << 8 | data[0])


cdef inline int16_t code_of(double x, double scale) noexcept nogil:
    """Return the nearest code, saturated at the ends. x must not be NaN."""
    cdef double code = floor(x / scale + 0.5)
    return <int16_t>(32767.0 if code > 32767.0 else -32768.0 if code < -32768.0 else code)


cdef inline void put_big(uint8_t *data, int16_t code) noexcept nogil:
    data[0] = <uint8_t>(<uint32_t>code >> 8 & 0xFF)
    data[1] = <uint8_t>(<uint32_t>code & 0xFF)


cdef inline void put_little(uint8_t *data, int16_t code) noexcept nogil:
    data[0] = <uint8_t>(<uint32_t>code & 0xFF)
    data[1] = <uint8_t>(<uint32_t>code >> 8 & 0xFF)
