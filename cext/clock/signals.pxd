from libc.stdint cimport int32_t

from cext.posix cimport action, sigset_t

cdef enum:
    ENDING = 5                       # signals that end a run

ctypedef void (*ignored_t)() noexcept nogil

cdef void unblock(sigset_t *before) noexcept nogil

cdef class Signals:
    cdef action[ENDING] before
    cdef sigset_t mask               # mask of the thread before `take`
    cdef bint handled                # False: handlers of the process are kept
    cdef int32_t never               # target of `caught` in that case: 0
    cdef const int32_t *caught       # number of the first signal since `take`, 0 if none
    cdef ignored_t ignored           # called by a signal RESPONSE_LIMIT after the first, or NULL

    cdef void take(self)
    cdef void install(self, action *before, sigset_t *mask) noexcept nogil
    cdef void give_back(self)
