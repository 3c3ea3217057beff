# cython: freethreading_compatible=True
"""Filters other than biquads."""

from libc.math cimport NAN
from libc.stdint cimport int32_t
from libc.string cimport memmove

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport clip, finite, is_finite


cdef struct Exponential:
    int32_t u, y, time_constant, state

EXPONENTIAL = items((<Exponential *>ITEMS)[0], "u[...] y[...] state[...]")


cdef int exponential_kernel(double *arena, const Exponential *at, const Exponential *sizes) noexcept nogil:
    cdef double share = arena[DT] / (arena[at.time_constant] + arena[DT])
    cdef double *state = arena + at.state
    cdef double u, y
    cdef int i
    for i in range(sizes.y):
        u = arena[at.u + i]
        if is_finite(u):
            y = state[i]
            if y != y:
                y = u                           # first input
            elif u > y:
                y += share * (u - y)
                if y > u:
                    y = u                       # rounding must not cause an overshoot
            elif u < y:
                y += share * (u - y)
                if y < u:
                    y = u
            state[i] = y
            u = y
        arena[at.y + i] = u
    return OK


cdef struct Complementary:
    int32_t rate, angle, fused, time_constant, state

COMPLEMENTARY = items((<Complementary *>ITEMS)[0], "rate[...] angle[...] fused[...] state[...]")


cdef int complementary_kernel(double *arena, const Complementary *at, const Complementary *sizes) noexcept nogil:
    cdef double h = arena[DT]
    cdef double slow = arena[at.time_constant]
    cdef double *state = arena + at.state
    cdef double rate, angle, y
    cdef int i
    for i in range(sizes.fused):
        rate = arena[at.rate + i]
        angle = arena[at.angle + i]
        y = state[i]
        if y != y:
            y = angle + 0.0 * rate              # first sample: the angle, or NaN if either input is NaN
        else:
            y = (slow * (y + h * rate) + h * angle) / (slow + h)
        if is_finite(y):
            state[i] = y
        arena[at.fused + i] = y
    return OK


cdef struct Median:
    int32_t u, y
    int32_t ring                # inputs with all their elements
    int32_t ordered             # for each element: the inputs in the ring in ascending order, without NaN
    int32_t place
    int32_t counts              # for each element: count of numbers in `ordered`, and of NaN in the ring

MEDIAN = items((<Median *>ITEMS)[0], "u[...] y[...] ring[...] ordered[...] counts[...]")


cdef int median_kernel(double *arena, const Median *at, const Median *sizes) noexcept nogil:
    cdef int length = sizes.ring // sizes.y
    cdef int place = <int>arena[at.place]
    cdef double *ring = arena + at.ring
    cdef double *ordered = arena + at.ordered
    cdef double *counts = arena + at.counts
    cdef double u
    cdef int i, k, n
    for i in range(sizes.y):
        n = <int>counts[0]
        if counts[0] + counts[1] == length:     # 1. Remove the oldest.
            u = ring[place]
            if u != u:
                counts[1] -= 1.0
            else:
                k = 0
                while ordered[k] < u:
                    k += 1
                n -= 1
                memmove(ordered + k, ordered + k + 1, (n - k) * sizeof(double))
        u = finite(arena[at.u + i])
        ring[place] = u
        if u != u:
            counts[1] += 1.0
        else:                                   # 2. Insert the newest in order.
            k = n
            while k > 0 and ordered[k - 1] > u:
                ordered[k] = ordered[k - 1]
                k -= 1
            ordered[k] = u
            n += 1
        counts[0] = n
        if counts[1] > 0.0:
            u = NAN
        elif n & 1:
            u = ordered[n // 2]
        else:
            u = clip(0.5 * ordered[n // 2 - 1] + 0.5 * ordered[n // 2], ordered[n // 2 - 1], ordered[n // 2])
        arena[at.y + i] = u
        ring += length
        ordered += length
        counts += 2
    arena[at.place] = 0.0 if place + 1 == length else place + 1
    return OK


exponential = export(<kernel_t>exponential_kernel, EXPONENTIAL)
complementary = export(<kernel_t>complementary_kernel, COMPLEMENTARY)
median = export(<kernel_t>median_kernel, MEDIAN)
