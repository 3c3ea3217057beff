from libc.stdint cimport int64_t

from cext.clock.histogram cimport Histogram, add, summary
from cext.clock.deadline_clock cimport monotonic

cdef enum: # items of a lap: phases, then the steps of the schedule, then its devices
    WOKEN_LATE = 0
    RECEIVE = 1
    COMMAND = 2
    TRANSMIT = 3
    GIL_WAIT = 4
    PLANT = 5
    RECORD = 6
    FIRST_STEP = 7

cdef struct Laps:
    int64_t tick
    int64_t last                 # ns of CLOCK_MONOTONIC, end of the last lap
    int64_t longest              # ns, longest lap of this tick
    int item                     # item of the longest
    Histogram *waits             # for the GIL, or NULL
    Histogram *each              # one per item, or NULL

cdef inline int64_t lap(Laps *laps, int item) noexcept nogil:
    """Attribute the time since the last lap to `item`. Returns it in ns."""
    cdef int64_t now = monotonic()
    cdef int64_t took = now - laps.last
    laps.last = now
    if took > laps.longest:
        laps.longest, laps.item = took, item
    if laps.each != NULL:
        add(&laps.each[item], took, laps.tick)
    return took

cdef struct Blamed:
    int64_t times
    int64_t missed
    int64_t longest              # ns
    int64_t at                   # tick of the longest

cdef class Stopwatch:
    cdef Laps laps
    cdef Blamed *blamed          # one per item
    cdef int count
    cdef object schedule
    cdef list steps

    cdef void reset(self)
    cdef void begin(self, int64_t tick, int64_t now) noexcept nogil
    cdef void blame(self, int item, int64_t ns, int64_t missed) noexcept nogil
