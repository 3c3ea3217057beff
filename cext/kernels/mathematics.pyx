# cython: freethreading_compatible=True
"""Arithmetic on signals. NaN passes through every one of them."""

from libc.math cimport sin
from libc.stdint cimport int32_t

from cext.abi cimport INPUTS, OK, TIME, export


cdef int gain_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, gain
    cdef double *u = arena + slots[0]
    cdef double *y = arena + slots[1]
    cdef double factor = arena[slots[2]]
    cdef int i
    for i in range(sizes[1]):
        y[i] = factor * u[i]
    return OK


cdef int sum_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u1 ... un, y, weights[n]
    cdef int count = slots[INPUTS]
    cdef double *y = arena + slots[count]
    cdef double *weights = arena + slots[count + 1]
    cdef double total
    cdef int i, k
    for i in range(sizes[count]):
        total = weights[0] * arena[slots[0] + i]
        for k in range(1, count):
            total += weights[k] * arena[slots[k] + i]
        y[i] = total
    return OK


cdef int product_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # a, b, y
    cdef int i
    for i in range(sizes[2]):
        arena[slots[2] + i] = arena[slots[0] + i] * arena[slots[1] + i]
    return OK


cdef int sine_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, amplitude, frequency, phase, bias
    arena[slots[0]] = arena[slots[4]] + arena[slots[1]] * sin(6.283185307179586 * arena[slots[2]] * arena[TIME] + arena[slots[3]])
    return OK


cdef int step_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, before, after, time
    arena[slots[0]] = arena[slots[1]] if arena[TIME] < arena[slots[3]] else arena[slots[2]]
    return OK


gain = export(gain_kernel)
sum = export(sum_kernel)
product = export(product_kernel)
sine = export(sine_kernel)
step = export(step_kernel)
