from libc.stdint cimport int32_t

from cext.posix cimport action

cdef enum:
    ENDING = 5                       # signals that end a run

cdef class Signals:
    cdef action[ENDING] before
    cdef bint handled                # False: handlers of the process stay as they are
    cdef int32_t never               # what `caught` points to, then: 0
    cdef const int32_t *caught       # number of the first signal since `take`, 0 while there is none

    cdef void take(self)
    cdef void install(self, action *before) noexcept nogil
    cdef void give_back(self)
