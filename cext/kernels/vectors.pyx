# cython: freethreading_compatible=True
"""Vectors. NaN passes, by IEEE arithmetic."""

from libc.math cimport sqrt
from libc.stdint cimport int32_t

from cext.abi cimport INPUTS, OK, export


cdef int stack_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u1 ... un, y: all of u1, then all of u2, ...
    cdef int count = slots[INPUTS]
    cdef double *y = arena + slots[count]
    cdef int i, k
    for k in range(count):
        for i in range(sizes[k]):
            y[i] = arena[slots[k] + i]
        y += sizes[k]
    return OK


cdef int select_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, places[m]
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = arena[slots[0] + <int>arena[slots[2] + i]]
    return OK


cdef int norm_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef double *u = arena + slots[0]
    cdef double total = 0.0
    cdef int i
    for i in range(sizes[0]):
        total += u[i] * u[i]
    arena[slots[1]] = sqrt(total)
    return OK


cdef int dot_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # a, b, y
    cdef double total = 0.0
    cdef int i
    for i in range(sizes[0]):
        total += arena[slots[0] + i] * arena[slots[1] + i]
    arena[slots[2]] = total
    return OK


cdef int cross_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # a, b, y
    cdef double *a = arena + slots[0]
    cdef double *b = arena + slots[1]
    cdef double *y = arena + slots[2]
    y[0] = a[1] * b[2] - a[2] * b[1]
    y[1] = a[2] * b[0] - a[0] * b[2]
    y[2] = a[0] * b[1] - a[1] * b[0]
    return OK


cdef int matrix_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, entries[m n], one row after the other
    cdef double *u = arena + slots[0]
    cdef double *row = arena + slots[2]
    cdef double total
    cdef int i, k
    for i in range(sizes[1]):
        total = 0.0
        for k in range(sizes[0]):
            total += row[k] * u[k]
        arena[slots[1] + i] = total
        row += sizes[0]
    return OK


stack = export(stack_kernel)
select = export(select_kernel)
norm = export(norm_kernel)
dot = export(dot_kernel)
cross = export(cross_kernel)
matrix = export(matrix_kernel)
