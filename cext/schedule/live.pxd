"""Table of live parameters in the loop, and their update at the start of a tick."""

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.ring.mailbox cimport Letter
from cext.memory.shared_state cimport SharedLayout, load_u64
from cext.schedule.held_outputs cimport HeldOutputs
from cext.schedule.live_rules cimport LiveParameter, LiveRules
from cext.clock.stopwatch cimport Laps

cdef enum:
    STOP_WANTED = -1            # in addition to the statuses of kernels: the operator or a process requests the end

cdef struct Scripted:           # a change of a recording
    int64_t tick
    int32_t parameter
    double value
    double slew

cdef class LiveTable:
    cdef LiveParameter *parameters
    cdef LiveRules rules
    cdef HeldOutputs held
    cdef int count
    cdef int moving             # number that have not reached their target
    cdef uint64_t seen          # value of the mailbox's `posted`
    cdef Scripted *script
    cdef int scripted, played   # number of changes in the script, and of those carried out
    cdef int64_t due            # tick of the next change
    cdef int64_t marks
    cdef double *arena
    cdef Laps *laps             # NULL: not timed
    cdef int64_t gil_taken
    cdef list entries
    cdef readonly object error  # exception of setting an attribute
    cdef readonly str culprit   # path of its block

    cdef void forgive(self)
    cdef void assume(self, int slot, double value) noexcept nogil
    cdef void show(self, SharedLayout *layout) noexcept nogil
    cdef void dismiss(self, SharedLayout *layout) noexcept nogil
    cdef int work(self, SharedLayout *layout, int64_t tick, double dt) noexcept nogil
    cdef void play(self, SharedLayout *layout, int64_t tick) noexcept nogil
    cdef void take(self, SharedLayout *layout, int64_t tick) noexcept nogil
    cdef int check(self, const Letter *letter) noexcept nogil
    cdef int check_values(self, const Letter *letter) noexcept nogil
    cdef object place(self, list targets, int index, double value)
    cdef bint carry_out(self, SharedLayout *layout, const Letter *letter, int64_t tick) noexcept nogil
    cdef int advance(self, double dt) noexcept nogil
    cdef int update_python(self, Laps *laps) noexcept nogil

cdef void record_request(SharedLayout *layout, int32_t kind, int32_t origin, uint64_t process, int64_t tick) noexcept nogil

cdef inline int apply_changes(LiveTable live, SharedLayout *layout, int64_t tick, double dt) noexcept nogil:
    """Apply requests of the mailbox and ramps, at the start of a tick that follows the previous one after dt s.

    Returns OK, PYTHON_ERROR or STOP_WANTED. With tick -1, while arming, only a stop takes effect; letters wait for
    tick 0.
    """
    if live.moving == 0 and tick < live.due and (layout == NULL or load_u64(&layout.mailbox.posted) == live.seen
            and load_u64(&layout.operator.stop) == 0):
        return 0
    return live.work(layout, tick, dt)
