# cython: freethreading_compatible=True
"""Native kernels of the gait laboratory."""

from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, export, items, kernel_t

cdef struct Leaky:
    int32_t u, y, leak, held

LEAKY = items((<Leaky *>ITEMS)[0])


cdef int leaky_kernel(double *arena, const Leaky *at, const Leaky *sizes) noexcept nogil:
    cdef double y = arena[at.u] + (1.0 - arena[at.leak]) * arena[at.held]
    arena[at.y] = y
    if y == y:
        arena[at.held] = y
    return OK


leaky = export(<kernel_t>leaky_kernel, LEAKY)
