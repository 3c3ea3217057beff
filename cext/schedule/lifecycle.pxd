from libc.stdint cimport int32_t, int64_t

from cext.schedule.arming cimport Arming

cdef enum:
    REQUESTS = 16               # inputs that request arming again
    ENDED = -2                  # in addition to the statuses of kernels: the run ends while it waits to be armed again

cdef class Waiting(Arming):
    cdef int64_t hung            # ns that a hung tick ran, 0 for none
    cdef object notify             # callback for faults that are survived, or None
    cdef int[REQUESTS] request_slots         # slots of the arena, each true while its input requests arming again
    cdef int request_count
    cdef int to_blame            # stopwatch item of the last overrun

    cdef int request(self, slots) except -1
    cdef int cause(self, int status) noexcept nogil
    cdef bint is_survived(self, int status)
    cdef object outcome(self, int status, tuple unanswered=*)
    cdef void call_notify(self, str what, outcome)
    cdef void notify_standing(self, str what, int standing) noexcept nogil
    cdef int wait(self, int64_t ticks, double arming_timeout) noexcept nogil
    cdef bint input_requests(self, bint before) noexcept nogil
    cdef int look_around(self, int64_t tick, int before, int *status) noexcept nogil
    cdef void forgive(self, int status) noexcept nogil
    cdef int arm_again(self, int64_t tick, double timeout) noexcept nogil
