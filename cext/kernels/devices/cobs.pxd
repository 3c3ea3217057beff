"""Packets without a zero byte, ended by one: consistent overhead byte stuffing, and the checksum that is stuffed with them.

Each zero is replaced by the distance to the next, and a first byte has the distance to the first (Cheshire, Baker 1999). The checksum is
CRC-16/CCITT-FALSE, polynomial 0x1021, beginning with 0xFFFF.
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
    """Into `out`, which has room for count + count // 254 + 2 bytes, the zero at the end among them. Returns how many."""
    cdef int code = 0                       # where the distance goes
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
    """In place, of what stands in front of the zero. Returns how many bytes it was, -1 where it cannot be."""
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
