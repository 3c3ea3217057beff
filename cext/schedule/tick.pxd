from libc.stdint cimport int64_t

from cext.schedule.publisher cimport Publisher
from cext.clock.deadline_clock cimport DeadlineClock
from cext.schedule.program cimport Program
from cext.clock.stopwatch cimport Stopwatch
from cext.schedule.handover cimport Handover

cdef class TickBody:
    cdef Program control, plant
    cdef Publisher publisher
    cdef DeadlineClock clock
    cdef Handover *handover              # handover of the watchdog, NULL without one
    cdef int substeps
    cdef bint real_time
    cdef int64_t plant_tick
    cdef int64_t plant_due       # ns from the start of the run to the next step of the plant
    cdef readonly Stopwatch watch        # stopwatch of the robot
    cdef readonly Stopwatch plant_watch  # stopwatch of its plant, with a profile

    cdef void reset(self)
    cdef void set_clock(self, int64_t tick, int64_t previous, int64_t late) noexcept nogil
    cdef int run(self, int64_t tick, int64_t previous, int64_t now) noexcept nogil
    cdef int advance_plant(self, int64_t now) noexcept nogil
    cdef void advance_plant_until(self, int64_t until) noexcept nogil
    cdef int step_plant(self, int64_t instant) noexcept nogil
