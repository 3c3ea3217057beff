"""Blocks with any number of inputs: reduction by a function of two numbers, element by element."""

from libc.stdint cimport int32_t

from cext.abi cimport OK, Rest, each

ctypedef double (*pair_t)(double a, double b) noexcept nogil

cdef struct Fold:
    int32_t y
    Rest inputs


cdef inline int fold(double *arena, const Fold *at, const Fold *sizes, pair_t combine) noexcept nogil:
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef double result
    cdef int i, k
    for i in range(sizes.y):
        result = arena[inputs[0] + i]
        for k in range(1, at.inputs.count):
            result = combine(result, arena[inputs[k] + i])
        arena[at.y + i] = result
    return OK
