"""Detection that the computer was suspended in the middle of a run: no process saw time pass, and no drive a command."""

from libc.stdint cimport int64_t

from cext.clock.deadline_clock cimport suspended_time
from cext.memory.shared_state cimport FENCED_FOR_GOOD, SharedLayout, load_i64, store_i32
from cext.safety.thresholds cimport SUSPEND_LIMIT

cdef inline int64_t suspended_since(SharedLayout *layout) noexcept nogil:
    """Return the ns for which the computer was suspended since the run began, 0 without a suspend."""
    cdef int64_t since = suspended_time() - layout.asleep
    return since if since > SUSPEND_LIMIT else 0

cdef inline bint fence_after_suspend(SharedLayout *layout) noexcept nogil:
    """Raise the fence permanently if the computer was suspended since the run began. Returns whether it was.

    Only a run with a guardian is concerned.
    """
    if load_i64(&layout.guard) == 0 or suspended_since(layout) == 0:
        return False
    store_i32(&layout.fence, FENCED_FOR_GOOD)
    return True
