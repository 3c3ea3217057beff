# cython: freethreading_compatible=True
"""The grid of a run, and the sleep to its points: absolute instants of CLOCK_MONOTONIC."""

from libc.errno cimport EINTR

from cext.posix cimport TIMER_ABSTIME, clock_nanosleep
from cext.signals cimport Signals


cdef class Pace:
    """Point k of the grid stands at k / rate, whatever happened before."""

    def __init__(self, double rate, Signals signals):
        if not 0.0 < rate <= 1e9:
            raise ValueError("the rate must be above 0 Hz and at most 1e9 Hz, as the grid is in ns, not %r" % rate)
        self.rate, self.caught = rate, signals.caught
        self.period = <int64_t>(1e9 / rate + 0.5)

    cdef int64_t grid(self, int64_t tick) noexcept nogil:
        """ns from tick 0 to `tick`, without the drift of a rounded period."""
        return <int64_t>(tick * (1e9 / self.rate) + 0.5)

    cdef int64_t newest(self, int64_t ns) noexcept nogil:
        """The grid point that is due `ns` after tick 0."""
        return <int64_t>(ns * (self.rate * 1e-9))

    cdef void sleep_until(self, int64_t deadline) noexcept nogil:
        """Sleep to an absolute instant; a signal that we act on ends the sleep, any other does not."""
        cdef timespec request
        request.tv_sec = deadline // 1000000000
        request.tv_nsec = deadline % 1000000000
        while clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &request, NULL) == EINTR and self.caught[0] == 0:
            pass
