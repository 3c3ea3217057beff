from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.atomics cimport load_i32, store_i64, store_u64, swap
from cext.schedule.publisher cimport Publisher
from cext.posix cimport cpu_set_t, pthread_t
from cext.schedule.program cimport Program

cdef enum: # owner of the buses, the devices and the ring of the shared state
    LOOP = 0                     # the thread of the ticks
    UNOWNED = 1                   # no owner: the loop runs a step that uses none of them
    WATCHDOG = 2                 # the watchdog: the step did not return

cdef struct Handover:
    uint64_t user
    # ns of CLOCK_MONOTONIC, begin of the tick's work, later by the time of its steps with an allowance; 0 between ticks
    int64_t since
    int64_t allowed              # ns, allowance of the present step

cdef inline void release(Handover *handover) noexcept nogil:
    """Release the buses before a step. `handover` may be NULL, without a watchdog."""
    if handover != NULL:
        store_u64(&handover.user, UNOWNED)

cdef inline bint acquire(Handover *handover) noexcept nogil:
    """Acquire the buses after a step. Returns False if the step took too long: the loop then sends nothing more."""
    return handover == NULL or swap(&handover.user, UNOWNED, LOOP)

cdef class Watchdog:
    cdef Handover *handover      # NULL without a watchdog
    cdef Handover shared
    cdef Program program
    cdef Publisher journal
    cdef const int32_t *caught
    cdef pthread_t thread, loop
    cdef bint running
    cdef object before           # previous handler of SIGURG
    cdef int priority            # of SCHED_FIFO, 0 for an ordinary thread
    cdef cpu_set_t processors    # of the watchdog; none: those of the loop
    cdef int32_t leave
    cdef int32_t hung
    cdef int64_t limit           # ns of work of a tick
    cdef int64_t start_allowance # ns in addition for the start of blocks
    cdef int64_t zero            # ns of CLOCK_MONOTONIC, begin of the run
    cdef int64_t began           # ns of CLOCK_MONOTONIC, begin of the hung tick's work
    cdef int at                  # stopwatch item in which it hung

    cdef int start(self) except -1
    cdef int end(self) except -1
    cdef void dismiss(self) noexcept nogil
    cdef void watch(self) noexcept nogil
    cdef void stop(self, int64_t now) noexcept nogil
    cdef bint running_ticks(self) noexcept nogil
    cdef void sleep(self, int64_t until) noexcept nogil

    cdef inline void begin_work(self, int64_t now) noexcept nogil:
        """Begin a tick. now : ns of CLOCK_MONOTONIC"""
        store_i64(&self.shared.allowed, 0)
        store_i64(&self.shared.since, now)

    cdef inline void end_work(self) noexcept nogil:
        store_i64(&self.shared.since, 0)

    cdef inline bint has_bitten(self) noexcept nogil:
        """Return whether a tick hung."""
        return load_i32(&self.hung) != 0
