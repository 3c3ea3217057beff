"""Conversions of numbers to integers that are defined for every number: clamped to the range of the type, and 0 for NaN.

In C the conversion of a number outside that range is undefined: x86-64 returns the smallest integer, Armv8 the nearest,
so that 1e30 becomes full left on one and full right on the other.
"""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t


cdef inline int64_t to_i64(double x) noexcept nogil:
    """Return x without its fraction."""
    # the largest double below 2^63
    return <int64_t>(x if -9.2233720368547748e18 <= x <= 9.2233720368547748e18 else 0.0 if x != x
        else 9.2233720368547748e18 if x > 0.0 else -9.2233720368547748e18)


cdef inline int64_t inside_of(double x, int64_t low, int64_t high) noexcept nogil:
    """Return x without its fraction, clamped."""
    cdef int64_t whole = to_i64(x)
    return low if whole < low else high if whole > high else whole


cdef inline int32_t to_i32(double x) noexcept nogil:
    return <int32_t>inside_of(x, -2147483648, 2147483647)


cdef inline uint32_t to_u32(double x) noexcept nogil:
    return <uint32_t>inside_of(x, 0, 4294967295)


cdef inline uint8_t to_u8(double x) noexcept nogil:
    return <uint8_t>inside_of(x, 0, 255)
