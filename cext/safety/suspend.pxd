"""Detection that the computer was suspended, or all processes of a run were paused, in the middle of the run: no process
saw time pass, and no drive a command.
"""

from libc.stdint cimport int64_t

from cext.clock.deadline_clock cimport monotonic, suspended_time
from cext.memory.shared_state cimport FENCED_FOR_GOOD, SharedLayout, load_i64, store_i32, store_i64
from cext.safety.thresholds cimport SUSPEND_LIMIT

cdef inline int64_t suspended_since(SharedLayout *layout) noexcept nogil:
    """Return the ns for which the computer was suspended since the run began, or the loop was paused; 0 for neither."""
    cdef int64_t since = suspended_time() - layout.asleep
    return since if since > SUSPEND_LIMIT else load_i64(&layout.paused)

cdef inline bint fence_after_suspend(SharedLayout *layout) noexcept nogil:
    """Raise the fence permanently if the computer was suspended since the run began, or the loop is paused since its
    beat. Returns whether that is so.

    Only a run with a guardian is concerned. A guardian that was not paused would have stopped the run before.
    """
    cdef int64_t silent
    if load_i64(&layout.guard) == 0:
        return False
    silent = monotonic() - load_i64(&layout.beat)
    if 0 < layout.pause_limit < silent:
        store_i64(&layout.paused, silent)
    if suspended_since(layout) == 0:
        return False
    store_i32(&layout.fence, FENCED_FOR_GOOD)
    return True
