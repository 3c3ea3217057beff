"""Numbers in fields of bits, as MIT's firmware has them and every drive after it.

A code is (x - low) (2^n - 1) / (high - low), truncated and clamped: it never wraps, and what is not a number is the lowest code.
"""

from libc.stdint cimport uint8_t, uint32_t


cdef inline uint32_t to_code(double x, double low, double high, int bits) noexcept nogil:
    cdef uint32_t top = (1 << bits) - 1
    if not x > low:
        return 0
    if x >= high:
        return top
    return <uint32_t>((x - low) * top / (high - low))


cdef inline double from_code(uint32_t code, double low, double high, int bits) noexcept nogil:
    return low + code * (high - low) / ((1 << bits) - 1)


# MIT mode: 64 bits of a command, p16 v12 kp12 kd12 t12, most significant bit first. `wire` has half the range of each, in this order.

cdef inline void pack(uint8_t *data, uint32_t p, uint32_t v, uint32_t kp, uint32_t kd, uint32_t t) noexcept nogil:
    data[0] = <uint8_t>(p >> 8)
    data[1] = <uint8_t>p
    data[2] = <uint8_t>(v >> 4)
    data[3] = <uint8_t>((v & 15) << 4 | kp >> 8)
    data[4] = <uint8_t>kp
    data[5] = <uint8_t>(kd >> 4)
    data[6] = <uint8_t>((kd & 15) << 4 | t >> 8)
    data[7] = <uint8_t>t


cdef inline void unpack(const uint8_t *data, const double *wire, double *command) noexcept nogil:
    command[0] = from_code(<uint32_t>data[0] << 8 | data[1], -wire[0], wire[0], 16)
    command[1] = from_code(<uint32_t>data[2] << 4 | data[3] >> 4, -wire[1], wire[1], 12)
    command[2] = from_code((<uint32_t>data[3] & 15) << 8 | data[4], 0.0, wire[2], 12)
    command[3] = from_code(<uint32_t>data[5] << 4 | data[6] >> 4, 0.0, wire[3], 12)
    command[4] = from_code((<uint32_t>data[6] & 15) << 8 | data[7], -wire[4], wire[4], 12)


cdef inline bint all_ones(const uint8_t *data, int count) noexcept nogil:
    cdef int i
    for i in range(count):
        if data[i] != 0xFF:
            return False
    return True
