from libc.stdint cimport int32_t

from cext.posix cimport action

cdef class Signals:
    cdef action[3] before
    cdef const int32_t *caught       # number of the first signal since `take`, 0 while there is none

    cdef void take(self)
    cdef void give_back(self)
