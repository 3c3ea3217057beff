"""Numbers in bit fields, as in the firmware of MIT's drives and those derived from it.

A code is (x - low) (2^n - 1) / (high - low), truncated and clamped: it never wraps, and NaN is the lowest code.
"""

from libc.stdint cimport uint32_t


cdef inline uint32_t to_code(double x, double low, double high, int bits) noexcept nogil:
    cdef uint32_t top = (1 << bits) - 1
    if not x > low:
        return 0
    if x >= high:
        return top
    return <uint32_t>((x - low) * top / (high - low))


cdef inline uint32_t to_code_inward(double x, double half, int bits) noexcept nogil:
    """Return the code in a range of -half to half whose value is next to x, towards zero."""
    return (1 << bits) - 1 - to_code(-x, -half, half, bits) if x < 0.0 else to_code(x, -half, half, bits)


cdef inline double from_code(uint32_t code, double low, double high, int bits) noexcept nogil:
    return low + code * (high - low) / ((1 << bits) - 1)
