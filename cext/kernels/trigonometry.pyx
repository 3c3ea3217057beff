# cython: freethreading_compatible=True
"""Trigonometry, by libm. NaN passes; arguments outside the domain and infinities result in NaN."""

from libc.math cimport acos, asin, atan, atan2, cos, sin, tan
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport finite

ctypedef double (*function_t)(double) noexcept nogil


cdef struct Function:
    int32_t u, y

FUNCTION = items((<Function *>ITEMS)[0], "u[...] y[...]")


cdef inline int apply(double *arena, const Function *at, const Function *sizes, function_t function) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = function(finite(arena[at.u + i]))
    return OK


cdef int sine_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    return apply(arena, at, sizes, sin)


cdef int cosine_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    return apply(arena, at, sizes, cos)


cdef int tangent_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    return apply(arena, at, sizes, tan)


cdef int arcsine_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    return apply(arena, at, sizes, asin)


cdef int arccosine_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    return apply(arena, at, sizes, acos)


cdef int arctangent_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    return apply(arena, at, sizes, atan)


cdef struct Angle:
    int32_t opposite, adjacent, y

ANGLE = items((<Angle *>ITEMS)[0], "opposite[...] adjacent[...] y[...]")


cdef int angle_kernel(double *arena, const Angle *at, const Angle *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = atan2(finite(arena[at.opposite + i]), finite(arena[at.adjacent + i]))
    return OK


sine = export(<kernel_t>sine_kernel, FUNCTION)
cosine = export(<kernel_t>cosine_kernel, FUNCTION)
tangent = export(<kernel_t>tangent_kernel, FUNCTION)
arcsine = export(<kernel_t>arcsine_kernel, FUNCTION)
arccosine = export(<kernel_t>arccosine_kernel, FUNCTION)
arctangent = export(<kernel_t>arctangent_kernel, FUNCTION)
angle = export(<kernel_t>angle_kernel, ANGLE)
