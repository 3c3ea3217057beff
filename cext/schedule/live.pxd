"""Live parameters as the loop has them: the table, and what is done about it at the start of a tick."""

from cpython.object cimport PyObject
from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.ring.mailbox cimport Letter
from cext.safety.shared_state cimport SharedLayout, load_u64
from cext.clock.stopwatch cimport Laps

cdef enum:
    STOP_WANTED = -1            # beside the statuses of kernels: somebody asks for the end of the run

cdef struct LiveParameter:
    int32_t slot                # in the arena, -1 if only Python has it
    bint whole                  # an int or a bool
    double low, high
    double slew                 # unit per second; infinite where it steps
    double built_slew           # at reset
    double built                # at reset
    double value
    double target
    bint changed                # in this tick
    PyObject *block             # whose attribute it is, or NULL

cdef struct Scripted:           # a change that a recording has
    int64_t tick
    int32_t parameter
    double value
    double slew

cdef class LiveTable:
    cdef LiveParameter *parameters
    cdef int count
    cdef int moving             # how many have not reached their target
    cdef uint64_t seen          # of the mailbox's `posted`
    cdef int32_t awaited        # kind of letters that are left to `asked`; -1: none are
    cdef Scripted *script
    cdef int scripted, played   # how many there are, and have been carried out
    cdef int64_t due            # tick of the next one
    cdef int64_t marks
    cdef double *arena
    cdef Laps *laps             # NULL: the parts of a tick are not timed
    cdef int64_t gil_taken
    cdef list entries
    cdef readonly object error  # what the code behind an attribute has raised
    cdef readonly str culprit   # path of the block where it did

    cdef void forgive(self)
    cdef void show(self, SharedLayout *page) noexcept nogil
    cdef void dismiss(self, SharedLayout *page) noexcept nogil
    cdef int work(self, SharedLayout *page, int64_t tick, double dt) noexcept nogil
    cdef bint stop_wanted(self, SharedLayout *page, int64_t tick) noexcept nogil
    cdef bint waits(self, SharedLayout *page, int32_t kind) noexcept nogil
    cdef bint asked(self, SharedLayout *page, int32_t kind, int64_t tick, int32_t verdict) noexcept nogil
    cdef void play(self, SharedLayout *page, int64_t tick) noexcept nogil
    cdef int take(self, SharedLayout *page, int64_t tick) noexcept nogil
    cdef int check(self, const Letter *letter) noexcept nogil
    cdef bint carry_out(self, SharedLayout *page, const Letter *letter, int64_t tick) noexcept nogil
    cdef int advance(self, double dt) noexcept nogil
    cdef int tell_python(self, Laps *laps) noexcept nogil

cdef inline int apply_changes(LiveTable live, SharedLayout *page, int64_t tick, double dt) noexcept nogil:
    """What the mailbox asks for and what is on its way, at the start of a tick that comes dt s after the one before.

    OK, PYTHON_ERROR or STOP_WANTED. With tick -1, while arming, only a stop is heard; the rest waits for tick 0.
    """
    if page == NULL or live.moving == 0 and tick < live.due and load_u64(&page.mailbox.posted) == live.seen:
        return 0
    return live.work(page, tick, dt)
