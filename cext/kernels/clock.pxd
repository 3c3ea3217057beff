"""Time comparisons for kernels that act at a given time."""

from cext.abi cimport PERIOD, TIME


cdef inline double just_after(const double *arena) noexcept nogil:
    """Return the time plus a thousandth of a period, in s, so that rounding does not delay an event by a tick."""
    return arena[TIME] + 1e-3 * arena[PERIOD]
