from libc.stdint cimport int32_t, int64_t

from cext.atomics cimport load_i32, store_i64
from cext.schedule.handover cimport Handover
from cext.schedule.publisher cimport Publisher
from cext.posix cimport cpu_set_t, pthread_t
from cext.schedule.program cimport Program

cdef class Watchdog:
    cdef Handover *handover      # NULL without a watchdog
    cdef Handover shared
    cdef Program program
    cdef Publisher publisher
    cdef const int32_t *caught
    cdef pthread_t thread, loop
    cdef bint running
    cdef object before           # previous handler of SIGURG
    cdef int priority            # priority of SCHED_FIFO, 0 for an ordinary thread
    cdef cpu_set_t processors    # processors of the watchdog; none: those of the loop
    cdef int32_t leave
    cdef int32_t awake           # 1 once its thread has its priority
    cdef int32_t hung
    cdef int64_t limit           # ns of work of a tick
    cdef int64_t start_allowance # ns in addition for the start of blocks
    cdef int64_t zero            # ns of CLOCK_MONOTONIC, start of the run
    cdef int64_t began           # ns of CLOCK_MONOTONIC, start of the hung tick's work
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
