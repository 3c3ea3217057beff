"""Blocks with any number of inputs: all of them folded into one by a function of two numbers, element by element."""

from libc.stdint cimport int32_t

from cext.abi cimport INPUTS, OK

ctypedef double (*pair_t)(double a, double b) noexcept nogil


cdef inline int fold(double *arena, const int32_t *slots, const int32_t *sizes, pair_t combine) noexcept nogil:
    # u1 ... un, y
    cdef int count = slots[INPUTS]
    cdef double *y = arena + slots[count]
    cdef double found
    cdef int i, k
    for i in range(sizes[count]):
        found = arena[slots[0] + i]
        for k in range(1, count):
            found = combine(found, arena[slots[k] + i])
        y[i] = found
    return OK
