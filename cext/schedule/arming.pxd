from libc.stdint cimport int64_t

from cext.schedule.publisher cimport Publisher
from cext.clock.overrun cimport Overrun
from cext.clock.deadline_clock cimport DeadlineClock
from cext.memory.shared_state cimport SharedLayout
from cext.schedule.program cimport Program
from cext.clock.signals cimport Signals
from cext.bus.replay_bus cimport ReplayClock
from cext.schedule.tick cimport TickBody
from cext.schedule.watchdog cimport Watchdog

cdef enum:
    CUT = -3                    # in addition to the statuses of kernels: a signal or the reader ends the run

cdef class Arming:
    cdef Program control, plant
    cdef SharedLayout *layout
    cdef Signals signals
    cdef DeadlineClock clock
    cdef Publisher publisher
    cdef Overrun overrun
    cdef TickBody body
    cdef ReplayClock replay
    cdef Watchdog watchdog
    cdef bint virtual, simulated, carried
    cdef int64_t began, first_tick, tick, previous
    cdef int64_t armed           # first tick after arming
    cdef bint halted             # whether its safe stop has been performed since
    cdef object answered         # called when every device has replied, or None
    cdef object permitted        # called before arming: whether the position of every joint is certain; or None
    cdef bint confirm            # whether arming needs a confirmation
    cdef int arm_slot            # slot of the input that confirms while it is held, or -1
    cdef int64_t point           # grid point of the present round of arming
    cdef int64_t rounds          # of arming so far: drains of the buses
    cdef bint released           # whether that input was inactive since the question
    cdef int64_t pressed         # ns, from when on it was active; -1 while it is not
    cdef int64_t late            # ns, of the previous tick
    cdef int64_t now             # ns from the begin of the run to the present round or tick
    cdef int64_t grace           # ns of a pause of all processes that the run tolerates at least
    cdef int64_t stall           # ns, a delay of this length stops simulated time
    cdef readonly int64_t stalled    # grid points of real time at which simulated time stood still
    cdef int64_t signals_kept    # acquisitions of the GIL at the last installation of the signal handlers

    cdef void begin(self) noexcept nogil
    cdef int arm(self, double timeout) noexcept nogil
    cdef int start_from_here(self) noexcept nogil
    cdef int next_round(self) noexcept nogil
    cdef int finish_round(self, bint set_up) noexcept nogil
    cdef int close_relays(self) noexcept nogil
    cdef int await_answers(self, double timeout, bint each) noexcept nogil
    cdef int look_over(self) noexcept nogil
    cdef int look_over_again(self) noexcept nogil
    cdef void forget_input(self) noexcept nogil
    cdef bint is_held(self) noexcept nogil
    cdef int call_answered(self) noexcept nogil
    cdef int permission(self) noexcept nogil
    cdef int receive_while_arming(self) noexcept nogil
    cdef int64_t next_point(self, int64_t point, int64_t zero) noexcept nogil
    cdef bint is_stall(self, int64_t point, int64_t due) noexcept nogil
    cdef int64_t point_after_stall(self, int64_t point, int64_t due) noexcept nogil
    cdef int advance_plant_to(self, int64_t tick) noexcept nogil
    cdef void keep_signals(self, int64_t tick) noexcept nogil
    cdef void halt(self, double timeout) noexcept nogil
    cdef void count(self, int64_t tick, int64_t awaited, int64_t late, int64_t began) noexcept nogil
