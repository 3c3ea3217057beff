from libc.stdint cimport int64_t

from cext.clock.histogram cimport Histogram, add, summary
from cext.clock.deadline_clock cimport monotonic

cdef enum: # what a lap was spent with; the steps of the schedule follow, then its devices
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
    int64_t last                 # ns, CLOCK_MONOTONIC, when the last lap ended
    int64_t longest              # ns, of the laps of this tick
    int item                     # what that was spent with
    Histogram *waits             # for the GIL, or NULL
    Histogram *each              # one an item, NULL where only the longest is wanted

cdef inline int64_t lap(Laps *laps, int item) noexcept nogil:
    """What has passed since the last lap, in ns, was spent with `item`."""
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
    int64_t at                   # its tick

cdef class Stopwatch:
    cdef Laps laps
    cdef Blamed *blamed          # an item
    cdef int count
    cdef object schedule
    cdef list steps

    cdef void reset(self)
    cdef void begin(self, int64_t tick, int64_t now) noexcept nogil
    cdef void blame(self, int item, int64_t ns, int64_t missed) noexcept nogil
