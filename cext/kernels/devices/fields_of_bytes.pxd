"""Numbers in bytes, least significant first, by the code of their type. (blocks/sensors/fields.py)"""

from libc.math cimport rint
from libc.stdint cimport int8_t, int16_t, int32_t, int64_t, uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy

cdef enum: # types
    UINT8, INT8, UINT16, INT16, INT24, UINT32, INT32, FLOAT32, FLOAT64


cdef inline int size_of(int kind) noexcept nogil:
    return 1 if kind <= INT8 else 2 if kind <= INT16 else 3 if kind == INT24 else 4 if kind <= FLOAT32 else 8


cdef inline double number(const uint8_t *data, int kind) noexcept nogil:
    cdef uint32_t bits = data[0]
    cdef float single
    cdef double both
    cdef int i
    if kind == FLOAT64:
        memcpy(&both, data, 8)
        return both
    for i in range(1, size_of(kind)):
        bits |= <uint32_t>data[i] << 8 * i
    if kind == FLOAT32:
        memcpy(&single, &bits, 4)
        return single
    if kind == INT8:
        return <int8_t>bits
    if kind == INT16:
        return <int16_t>bits
    if kind == INT24:
        return <int32_t>(bits << 8) >> 8
    if kind == INT32:
        return <int32_t>bits
    return bits


cdef inline double inside(double x, double low, double high) noexcept nogil:
    return high if x > high else low if not x > low else x          # NaN becomes the lowest


cdef inline void put_number(uint8_t *data, int kind, double x) noexcept nogil:
    """Write x, rounded and clamped to the range of the type."""
    cdef int64_t whole
    cdef float single = <float>x
    cdef int bits = 8 * size_of(kind)
    cdef double span
    if kind == FLOAT64:
        memcpy(data, &x, 8)
        return
    if kind == FLOAT32:
        memcpy(data, &single, 4)
        return
    span = <double>(<int64_t>1 << bits)
    if kind == UINT8 or kind == UINT16 or kind == UINT32:
        whole = <int64_t>inside(rint(x), 0.0, span - 1.0)
    else:
        whole = <int64_t>inside(rint(x), -0.5 * span, 0.5 * span - 1.0)
    memcpy(data, &whole, size_of(kind))                               # supported processors are little-endian
