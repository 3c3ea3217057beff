"""Philox 4x64-10: random numbers that depend on a counter and a key only.

Equal to numpy.random.Philox. (Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3. SC'11.)
"""

from libc.math cimport M_PI, cos, log, sin, sqrt
from libc.stdint cimport uint64_t

cdef extern from *:
    ctypedef unsigned long long uint128_t "unsigned __int128"


cdef inline void philox(uint64_t tick, uint64_t seed, uint64_t *out) noexcept nogil:
    """Compute four numbers of 64 random bits from the counter (tick, 0, 0, 0) and the key (seed, 0)."""
    cdef uint64_t c0 = tick
    cdef uint64_t c1 = 0
    cdef uint64_t c2 = 0
    cdef uint64_t c3 = 0
    cdef uint64_t k0 = seed
    cdef uint64_t k1 = 0
    cdef uint128_t a, b
    cdef int i
    for i in range(10):
        a = <uint128_t>c0 * <uint64_t>0xD2E7470EE14C6C93ULL
        b = <uint128_t>c2 * <uint64_t>0xCA5A826395121157ULL
        c0 = <uint64_t>(b >> 64) ^ c1 ^ k0
        c1 = <uint64_t>b
        c2 = <uint64_t>(a >> 64) ^ c3 ^ k1
        c3 = <uint64_t>a
        k0 += <uint64_t>0x9E3779B97F4A7C15ULL
        k1 += <uint64_t>0xBB67AE8584CAA73BULL
    out[0], out[1], out[2], out[3] = c0, c1, c2, c3


cdef inline double fraction(uint64_t bits) noexcept nogil:
    """Return a number in [0, 1), a multiple of 2^-53."""
    return <double>(bits >> 11) * 1.1102230246251565e-16


cdef inline double normal(uint64_t a, uint64_t b) noexcept nogil:
    """Return a normally distributed number of 128 random bits. (Box and Muller 1958)"""
    return sqrt(-2.0 * log(1.0 - fraction(a))) * cos(2.0 * M_PI * fraction(b))


cdef inline void normals(const uint64_t *bits, double *out) noexcept nogil:
    """Compute four independent normally distributed numbers from the four of `philox`. (Box and Muller 1958)"""
    cdef double radius, angle
    cdef int k
    for k in range(2):
        radius = sqrt(-2.0 * log(1.0 - fraction(bits[2 * k])))
        angle = 2.0 * M_PI * fraction(bits[2 * k + 1])
        out[2 * k] = radius * cos(angle)
        out[2 * k + 1] = radius * sin(angle)
