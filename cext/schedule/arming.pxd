from libc.stdint cimport int64_t

from cext.schedule.publisher cimport Publisher
from cext.clock.overrun cimport Overrun
from cext.clock.deadline_clock cimport DeadlineClock
from cext.safety.shared_state cimport SharedLayout
from cext.schedule.program cimport Program
from cext.clock.signals cimport Signals
from cext.bus.replay_bus cimport ReplayClock
from cext.schedule.tick cimport Tick
from cext.schedule.watchdog cimport Watchdog

cdef class Arming:
    cdef Program control, plant
    cdef SharedLayout *layout
    cdef Signals signals
    cdef DeadlineClock pace
    cdef Publisher journal
    cdef Overrun overrun
    cdef Tick body
    cdef ReplayClock tape
    cdef Watchdog watchdog
    cdef bint virtual, simulated, carried
    cdef int64_t began, first_tick, tick, previous
    cdef int64_t armed           # the tick from which on it is armed
    cdef bint halted             # since then it has been brought to its safe stop
    cdef object answered         # called when every device has answered, or None
    cdef object permitted        # called before arming: whether every joint stands where its drive reads; or None
    cdef bint confirm            # whether somebody has to confirm, then
    cdef int64_t late            # ns, of the previous tick
    cdef int64_t now             # ns from the run's begin to the present round or tick

    cdef void begin(self) noexcept nogil
    cdef int arm(self, double timeout) noexcept nogil
    cdef int start_from_here(self) noexcept nogil
    cdef int look_over(self, double timeout) noexcept nogil
    cdef int look_over_again(self, int64_t drain) noexcept nogil
    cdef int call_answered(self) noexcept nogil
    cdef int permission(self) noexcept nogil
    cdef int hear_while_arming(self) noexcept nogil
    cdef int64_t next_point(self, int64_t point, int64_t zero) noexcept nogil
    cdef int advance_plant_to(self, int64_t tick) noexcept nogil
    cdef void halt(self, double timeout) noexcept nogil
    cdef void count(self, int64_t tick, int64_t awaited, int64_t late, int64_t began) noexcept nogil
