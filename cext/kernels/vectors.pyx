# cython: freethreading_compatible=True
"""Vectors. NaN passes, by IEEE arithmetic."""

from libc.math cimport sqrt
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, Rest, each, export, items, kernel_t


cdef struct Stack:
    int32_t y
    Rest inputs

STACK = items((<Stack *>ITEMS)[0], "y[...]")


cdef int stack_kernel(double *arena, const Stack *at, const Stack *sizes) noexcept nogil:
    """Concatenate the inputs in order."""
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef const int32_t *lengths = each(sizes, sizes.inputs)
    cdef double *y = arena + at.y
    cdef int i, k
    for k in range(at.inputs.count):
        for i in range(lengths[k]):
            y[i] = arena[inputs[k] + i]
        y += lengths[k]
    return OK


cdef struct Select:
    int32_t u, y, places

SELECT = items((<Select *>ITEMS)[0], "u[...] y[...] places[...]")


cdef int select_kernel(double *arena, const Select *at, const Select *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = arena[at.u + <int>arena[at.places + i]]
    return OK


cdef struct Norm:
    int32_t u, y

NORM = items((<Norm *>ITEMS)[0], "u[...]")


cdef int norm_kernel(double *arena, const Norm *at, const Norm *sizes) noexcept nogil:
    cdef double *u = arena + at.u
    cdef double total = 0.0
    cdef int i
    for i in range(sizes.u):
        total += u[i] * u[i]
    arena[at.y] = sqrt(total)
    return OK


cdef struct Dot:
    int32_t a, b, y

DOT = items((<Dot *>ITEMS)[0], "a[...] b[...]")


cdef int dot_kernel(double *arena, const Dot *at, const Dot *sizes) noexcept nogil:
    cdef double total = 0.0
    cdef int i
    for i in range(sizes.a):
        total += arena[at.a + i] * arena[at.b + i]
    arena[at.y] = total
    return OK


cdef struct Cross:
    int32_t a, b, y

CROSS = items((<Cross *>ITEMS)[0], "a[3] b[3] y[3]")


cdef int cross_kernel(double *arena, const Cross *at, const Cross *sizes) noexcept nogil:
    cdef double *a = arena + at.a
    cdef double *b = arena + at.b
    cdef double *y = arena + at.y
    y[0] = a[1] * b[2] - a[2] * b[1]
    y[1] = a[2] * b[0] - a[0] * b[2]
    y[2] = a[0] * b[1] - a[1] * b[0]
    return OK


cdef struct Matrix:
    int32_t u, y, entries

MATRIX = items((<Matrix *>ITEMS)[0], "u[...] y[...] entries[...]")


cdef int matrix_kernel(double *arena, const Matrix *at, const Matrix *sizes) noexcept nogil:
    cdef double *u = arena + at.u
    cdef double *row = arena + at.entries
    cdef double total
    cdef int i, k
    for i in range(sizes.y):
        total = 0.0
        for k in range(sizes.u):
            total += row[k] * u[k]
        arena[at.y + i] = total
        row += sizes.u
    return OK


stack = export(<kernel_t>stack_kernel, STACK)
select = export(<kernel_t>select_kernel, SELECT)
norm = export(<kernel_t>norm_kernel, NORM)
dot = export(<kernel_t>dot_kernel, DOT)
cross = export(<kernel_t>cross_kernel, CROSS)
matrix = export(<kernel_t>matrix_kernel, MATRIX)
