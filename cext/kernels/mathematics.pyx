# cython: freethreading_compatible=True
"""Arithmetic on signals. NaN passes through every one of them."""

from libc.math cimport sin
from libc.stdint cimport int32_t

from cext.abi cimport OK, TIME, export


cdef int gain_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, gain
    cdef double *u = arena + slots[0]
    cdef double *y = arena + slots[1]
    cdef double factor = arena[slots[2]]
    cdef int i
    for i in range(sizes[1]):
        y[i] = factor * u[i]
    return OK


cdef inline int add_up(double *arena, const int32_t *slots, const int32_t *sizes, int count) noexcept nogil:
    # u1 ... un, y, signs[n]
    cdef double *y = arena + slots[count]
    cdef double *signs = arena + slots[count + 1]
    cdef double total
    cdef int i, k
    for i in range(sizes[count]):
        total = signs[0] * arena[slots[0] + i]
        for k in range(1, count):
            total += signs[k] * arena[slots[k] + i]
        y[i] = total
    return OK


cdef int sum1_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 1)


cdef int sum2_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 2)


cdef int sum3_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 3)


cdef int sum4_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 4)


cdef int sum5_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 5)


cdef int sum6_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 6)


cdef int sum7_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 7)


cdef int sum8_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return add_up(arena, slots, sizes, 8)


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
sums = (
    None, export(sum1_kernel), export(sum2_kernel), export(sum3_kernel), export(sum4_kernel), export(sum5_kernel), export(sum6_kernel),
    export(sum7_kernel), export(sum8_kernel),
)
product = export(product_kernel)
sine = export(sine_kernel)
step = export(step_kernel)
