"""Consistent overhead byte stuffing (COBS), and the checksum of the packets.

A packet contains no zero byte and ends with one. Each zero is replaced by the distance to the next one, and the first
byte is the distance to the first zero (Cheshire, Baker 1999). The checksum is CRC-16/CCITT-FALSE, polynomial 0x1021,
initial value 0xFFFF.
"""

from libc.stdint cimport uint8_t, uint16_t


cdef inline uint16_t checksum(const uint8_t *data, int count) noexcept nogil:
    cdef uint16_t crc = 0xFFFF
    cdef uint16_t x
    cdef int i
    for i in range(count):                  # a byte at a time, without a table
        x = (crc >> 8) ^ data[i]
        x ^= x >> 4
        crc = <uint16_t>(crc << 8 ^ x << 12 ^ x << 5 ^ x)
    return crc


cdef inline int stuff(const uint8_t *data, int count, uint8_t *out) noexcept nogil:
    """Encode into `out`, of count + count // 254 + 2 bytes including the final zero. Returns the number of bytes."""
    cdef int code = 0                       # index of the distance byte
    cdef int at = 1
    cdef int i
    for i in range(count):
        if data[i] != 0:
            out[at] = data[i]
            at += 1
        if data[i] == 0 or at - code == 255:
            out[code] = <uint8_t>(at - code)
            code = at
            at += 1
    out[code] = <uint8_t>(at - code)
    out[at] = 0
    return at + 1


cdef inline int unstuff(uint8_t *data, int count) noexcept nogil:
    """Decode in place the bytes before the zero. Returns the number of decoded bytes, -1 for an invalid packet."""
    cdef int taken = 0
    cdef int at = 0
    cdef int code, i
    while taken < count:
        code = data[taken]
        if code == 0 or taken + code > count:
            return -1
        for i in range(1, code):
            data[at] = data[taken + i]
            at += 1
        taken += code
        if code < 255 and taken < count:
            data[at] = 0
            at += 1
    return at
