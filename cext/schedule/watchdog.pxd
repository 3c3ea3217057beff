from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.atomics cimport load_i32, store_i64, store_u64, swap
from cext.schedule.publisher cimport Publisher
from cext.posix cimport cpu_set_t, pthread_t
from cext.schedule.program cimport Program

cdef enum: # who may use the buses, the devices and the ring of the page
    LOOP = 0                     # the thread that runs the ticks,
    NOBODY = 1                   # which is in a step, where it needs none of them
    WATCHDOG = 2                 # and did not come back

cdef struct Handover:
    uint64_t user
    int64_t since                # ns, CLOCK_MONOTONIC at which the tick began to work; 0 between ticks

cdef inline void let_go(Handover *handover) noexcept nogil:
    """The loop goes into a step. `handover` may be NULL: there is no watchdog."""
    if handover != NULL:
        store_u64(&handover.user, NOBODY)

cdef inline bint take_back(Handover *handover) noexcept nogil:
    """The loop is out of it again. False: it was away for too long, and sends nothing any more."""
    return handover == NULL or swap(&handover.user, NOBODY, LOOP)

cdef class Watchdog:
    cdef Handover *handover      # NULL where nobody watches
    cdef Handover shared
    cdef Program program
    cdef Publisher journal
    cdef const int32_t *caught
    cdef pthread_t thread, loop
    cdef bint running
    cdef object before           # what SIGURG did
    cdef int priority            # of SCHED_FIFO, 0 for an ordinary thread
    cdef cpu_set_t processors    # that it stays on; none: those of the loop
    cdef int32_t leave
    cdef int32_t hung
    cdef int64_t limit           # ns that a tick may work
    cdef int64_t patience        # ns more that blocks have for their start
    cdef int64_t zero            # ns, CLOCK_MONOTONIC of the run's begin
    cdef int64_t began           # likewise, at which the tick that hung began to work
    cdef int at                  # item of the stopwatch that it hung with

    cdef int start(self) except -1
    cdef int end(self) except -1
    cdef void dismiss(self) noexcept nogil
    cdef void watch(self) noexcept nogil
    cdef void stop(self, int64_t now) noexcept nogil
    cdef bint running_ticks(self) noexcept nogil
    cdef void sleep(self, int64_t until) noexcept nogil

    cdef inline void begin_work(self, int64_t now) noexcept nogil:
        """A tick begins. now : ns, CLOCK_MONOTONIC"""
        store_i64(&self.shared.since, now)

    cdef inline void end_work(self) noexcept nogil:
        store_i64(&self.shared.since, 0)

    cdef inline bint has_bitten(self) noexcept nogil:
        """Whether a tick hung."""
        return load_i32(&self.hung) != 0
