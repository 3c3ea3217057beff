# cython: freethreading_compatible=True
"""Filters that are not biquads."""

from libc.math cimport NAN
from libc.stdint cimport int32_t
from libc.string cimport memmove

from cext.abi cimport DT, OK, export
from cext.kernels.limits cimport clip, finite, is_finite


cdef int exponential_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], time_constant, state[n]
    cdef double share = arena[DT] / (arena[slots[2]] + arena[DT])
    cdef double *state = arena + slots[3]
    cdef double u, y
    cdef int i
    for i in range(sizes[1]):
        u = arena[slots[0] + i]
        if is_finite(u):
            y = state[i]
            if y != y:
                y = u                           # the first input
            elif u > y:
                y += share * (u - y)
                if y > u:
                    y = u                       # rounding must not carry it past
            elif u < y:
                y += share * (u - y)
                if y < u:
                    y = u
            state[i] = y
            u = y
        arena[slots[1] + i] = u
    return OK


cdef int complementary_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # rate[n], angle[n], fused[n], time_constant, state[n]
    cdef double h = arena[DT]
    cdef double slow = arena[slots[3]]
    cdef double *state = arena + slots[4]
    cdef double rate, angle, y
    cdef int i
    for i in range(sizes[2]):
        rate = arena[slots[0] + i]
        angle = arena[slots[1] + i]
        y = state[i]
        if y != y:
            y = angle + 0.0 * rate              # the first: the angle, or NaN if either is
        else:
            y = (slow * (y + h * rate) + h * angle) / (slow + h)
        if is_finite(y):
            state[i] = y
        arena[slots[2] + i] = y
    return OK


cdef int median_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], samples, ring[samples n], ordered[samples n], place, counts[2 n]: numbers in `ordered`, NaN in the ring
    cdef int length = sizes[3] // sizes[1]
    cdef int place = <int>arena[slots[5]]
    cdef double *ring = arena + slots[3]
    cdef double *ordered = arena + slots[4]
    cdef double *counts = arena + slots[6]
    cdef double u
    cdef int i, k, n
    for i in range(sizes[1]):
        n = <int>counts[0]
        if counts[0] + counts[1] == length:     # 1. The oldest leaves.
            u = ring[place]
            if u != u:
                counts[1] -= 1.0
            else:
                k = 0
                while ordered[k] < u:
                    k += 1
                n -= 1
                memmove(ordered + k, ordered + k + 1, (n - k) * sizeof(double))
        u = finite(arena[slots[0] + i])
        ring[place] = u
        if u != u:
            counts[1] += 1.0
        else:                                   # 2. The newest takes its place in order.
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
        arena[slots[1] + i] = u
        ring += length
        ordered += length
        counts += 2
    arena[slots[5]] = 0.0 if place + 1 == length else place + 1
    return OK


exponential = export(exponential_kernel)
complementary = export(complementary_kernel)
median = export(median_kernel)
