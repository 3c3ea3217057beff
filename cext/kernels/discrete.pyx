# cython: freethreading_compatible=True
"""Delays and filters."""

from libc.stdint cimport int32_t

from cext.abi cimport OK, export


cdef int unit_delay_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, initial, held[n]
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = arena[slots[3] + i]
    return OK


cdef int unit_delay_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes[1]):
        arena[slots[3] + i] = arena[slots[0] + i]
    return OK


cdef int biquads_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, order, cutoff, sections[5 s] as b0 b1 b2 a1 a2, delays[2 s n]; direct form II transposed
    cdef int sections = sizes[4] // 5
    cdef double *c
    cdef double *z = arena + slots[5]
    cdef double x, y
    cdef int i, s
    for i in range(sizes[1]):
        x = arena[slots[0] + i]
        c = arena + slots[4]
        for s in range(sections):
            y = c[0] * x + z[0]
            z[0] = c[1] * x - c[3] * y + z[1]
            z[1] = c[2] * x - c[4] * y
            x = y
            c += 5
            z += 2
        arena[slots[1] + i] = x
    return OK


cdef int biquads_settle(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    """The delays of a filter that has seen the present input for ever."""
    cdef int sections = sizes[4] // 5
    cdef double *c
    cdef double *z = arena + slots[5]
    cdef double x, y
    cdef int i, s
    for i in range(sizes[1]):
        x = arena[slots[0] + i]
        c = arena + slots[4]
        for s in range(sections):
            y = x * (c[0] + c[1] + c[2]) / (1.0 + c[3] + c[4])
            z[1] = c[2] * x - c[4] * y
            z[0] = c[1] * x - c[3] * y + z[1]
            x = y
            c += 5
            z += 2
    return OK


unit_delay = export(unit_delay_kernel)
unit_delay_next = export(unit_delay_update)
biquads = export(biquads_kernel)
biquads_at_rest = export(biquads_settle)
