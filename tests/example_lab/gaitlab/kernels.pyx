# cython: freethreading_compatible=True
"""Native kernels of the gait laboratory."""

from libc.stdint cimport int32_t

from cext.abi cimport OK, export


cdef int leaky_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, leak, held
    cdef double y = arena[slots[0]] + (1.0 - arena[slots[2]]) * arena[slots[3]]
    arena[slots[1]] = y
    if y == y:
        arena[slots[3]] = y
    return OK


leaky = export(leaky_kernel)
