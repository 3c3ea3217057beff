"""Variation from stride to stride: values that are drawn once per stride and pass smoothly from one to the next.

Each is a first-order autoregressive process over the strides with a standard deviation of 1 over a stride. The values
of one leg share a part of their variance. Reproducible: a draw is a function of seed, leg and stride.
"""

from libc.math cimport sqrt
from libc.stdint cimport uint64_t

from cext.kernels.philox cimport normals, philox

cdef enum:
    VALUES = 7                  # of a leg: gain of hip, knee, ankle, offset of hip, knee, ankle, stride time
    STRIDE_TIME = 6

cdef struct Draws:              # of a leg
    double stride               # number of the stride that `before` belongs to
    double before[VALUES]
    double after[VALUES]

cdef inline double persistence() noexcept nogil:
    """Return the correlation of a stride with the next."""
    return 0.3


cdef inline double common() noexcept nogil:
    """Return the correlation of two values of a stride."""
    return 0.2


cdef inline void draw(Draws *leg, int side, uint64_t seed, double stride, double kept) noexcept nogil:
    """Draw `after` for a stride from `before`; with `kept` = 0 independently of it."""
    cdef uint64_t[4] bits
    cdef double[8] z
    cdef double fresh = sqrt(1.0 - kept * kept)
    # Half way between two strides the variance of the mean of both is (1 + persistence) / 2.
    cdef double scale = sqrt(2.0 / (1.0 + persistence())) * fresh
    cdef uint64_t number = <uint64_t>(4 * <long long>stride + 2 * side)
    cdef int k
    for k in range(2):
        philox(number + k, seed, bits)
        normals(bits, z + 4 * k)
    for k in range(VALUES):
        leg.after[k] = kept * leg.before[k] + scale * (sqrt(common()) * z[7] + sqrt(1.0 - common()) * z[k])


cdef inline void follow(Draws *leg, int side, uint64_t seed, double stride) noexcept nogil:
    """Draw what a new stride needs. stride : its number"""
    cdef int k
    if stride == leg.stride:
        return
    if leg.stride < 0.0:
        draw(leg, side, seed, stride, 0.0)
    leg.stride = stride
    for k in range(VALUES):
        leg.before[k] = leg.after[k]
    draw(leg, side, seed, stride + 1.0, persistence())
