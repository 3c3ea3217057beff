from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.memory.shared_state cimport SharedState, SharedLayout
from cext.schedule.program cimport Program

cdef class Publisher:
    cdef SharedState shared
    cdef SharedLayout *layout          # NULL without a shared
    cdef Program program, plant
    cdef bint virtual
    cdef int reader
    cdef const int32_t *caught
    cdef uint64_t question           # number of the newest question to the operator
    cdef int64_t asked               # ns of CLOCK_MONOTONIC, when it was asked
    cdef int64_t guard               # ns of the guardian's silence that end the run, 0: no guardian
    cdef bint pages                  # whether the loss of the page with the controls ends the run
    cdef int64_t link                # `page_link` of the page that is watched, 0: none, -1: it was lost at once
    cdef uint64_t most               # ring bytes of one tick, at most
    cdef object table                # the array behind `recent`
    cdef int width                   # numbers of a row in it
    cdef double *recent              # rows of the newest ticks, a ring; with `table`, of all ticks
    cdef int64_t recent_size         # capacity in rows
    cdef int64_t recent_count        # rows written in total
    cdef bint records                # whether rows have a destination
    cdef object drain                # empties the ring in this process, or None
    cdef bint drains                 # whether there is one
    cdef int64_t drained             # ns of CLOCK_MONOTONIC of its newest call
    cdef readonly object error       # the exception that it has raised

    cdef void clear(self)
    cdef void set_state(self, int32_t state) noexcept nogil
    cdef void ask(self) noexcept nogil
    cdef int32_t consent(self) noexcept nogil
    cdef bint fenced(self) noexcept nogil
    cdef void beat(self, int64_t now) noexcept nogil
    cdef bint program_is_silent(self, int64_t now) noexcept nogil
    cdef bint may_arm(self, int64_t now) noexcept nogil
    cdef void watch_page(self) noexcept nogil
    cdef bint page_is_lost(self, int64_t now) noexcept nogil
    cdef void note_lost_page(self) noexcept nogil
    cdef bint guardian_is_gone(self, int64_t now) noexcept nogil
    cdef bint guardian_is_late(self) noexcept nogil
    cdef int attend(self, int64_t now) noexcept nogil
    cdef bint was_suspended(self) noexcept nogil
    cdef void raise_fence(self) noexcept nogil
    cdef bint guardian_stops(self, int64_t now) noexcept nogil
    cdef void report_hang(self, int item) noexcept nogil
    cdef bint lower_fence(self) noexcept nogil
    cdef int attend_fenced(self, int64_t now) noexcept nogil
    cdef bint push_row(self, int64_t tick) noexcept nogil
    cdef bint make_room(self, bint stopping) noexcept nogil
    cdef bint wait_for_reader(self) noexcept nogil
    cdef bint drain_here(self) noexcept nogil
