# cython: freethreading_compatible=True
"""Trigonometry, by libm. NaN passes; what has no real value, and what infinity gives, is NaN."""

from libc.math cimport acos, asin, atan, atan2, cos, sin, tan
from libc.stdint cimport int32_t

from cext.abi cimport OK, export
from cext.kernels.limits cimport finite

ctypedef double (*function_t)(double) noexcept nogil


cdef inline int apply(double *arena, const int32_t *slots, const int32_t *sizes, function_t function) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = function(finite(arena[slots[0] + i]))
    return OK


cdef int sine_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return apply(arena, slots, sizes, sin)


cdef int cosine_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return apply(arena, slots, sizes, cos)


cdef int tangent_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return apply(arena, slots, sizes, tan)


cdef int arcsine_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return apply(arena, slots, sizes, asin)


cdef int arccosine_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return apply(arena, slots, sizes, acos)


cdef int arctangent_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return apply(arena, slots, sizes, atan)


cdef int angle_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # opposite, adjacent, y
    cdef int i
    for i in range(sizes[2]):
        arena[slots[2] + i] = atan2(finite(arena[slots[0] + i]), finite(arena[slots[1] + i]))
    return OK


sine = export(sine_kernel)
cosine = export(cosine_kernel)
tangent = export(tangent_kernel)
arcsine = export(arcsine_kernel)
arccosine = export(arccosine_kernel)
arctangent = export(arctangent_kernel)
angle = export(angle_kernel)
