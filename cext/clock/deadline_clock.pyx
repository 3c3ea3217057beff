# cython: freethreading_compatible=True
"""Deadlines of a run, as absolute times of CLOCK_MONOTONIC, and waiting for them."""

cimport cython
from libc.errno cimport EINTR

from cext.posix cimport TIMER_ABSTIME, clock_nanosleep
from cext.clock.signals cimport Signals


@cython.final
cdef class DeadlineClock:
    """Clock with deadline k at k / rate, exact to the nanosecond and independent of earlier delays.

    rate : Hz; its shortest decimal representation counts, so that seven periods at 0.7 Hz take exactly ten seconds
    spin : ns before a deadline at which sleeping ends and spinning begins
    """

    def __init__(self, double rate, Signals signals, *, int64_t spin=0):
        if not 0.0 < rate <= 1e9:
            raise ValueError("the rate must be above 0 Hz and at most 1e9 Hz, as the grid is in ns, not %r" % rate)
        if spin < 0:
            raise ValueError("the spin window must be 0 ns or more, not %d" % spin)
        from fractions import Fraction              # takes 9 ms, and other users of this module do not need it

        period = 10**9 / Fraction(repr(rate))
        if period >= 2**62:
            raise ValueError("a period of %g s exceeds the range of the clock" % (1.0 / rate))
        self.rate, self.window, self.caught = rate, spin, signals.caught
        self.period = round(period)
        self.whole = period.numerator // period.denominator
        self.share = ((period - self.whole) * 2**64).__floor__()

    cpdef int64_t grid(self, int64_t tick) noexcept nogil:
        """Return the ns from tick 0 to `tick`, rounded; in integers, as a double would be inexact after a hundred
        days.
        """
        return tick * self.whole + share_of(tick, self.share)

    cpdef int64_t newest(self, int64_t ns) noexcept nogil:
        """Return the grid point that is due `ns` after tick 0."""
        cdef int64_t tick = <int64_t>(ns * (self.rate * 1e-9))
        while self.grid(tick) > ns:
            tick -= 1
        while self.grid(tick + 1) <= ns:
            tick += 1
        return tick

    cdef void wait(self, int64_t deadline) noexcept nogil:
        """Wait for an absolute time: sleep, then spin in the window before it."""
        if monotonic() < deadline - self.window:
            self.sleeps += 1
            self.sleep_until(deadline - self.window)
        if self.window > 0 and monotonic() < deadline:
            self.spins += 1
            while monotonic() < deadline and self.caught[0] == 0:
                pause()

    cdef void sleep_until(self, int64_t deadline) noexcept nogil:
        """Sleep until a deadline or a signal that ends the run; other signals do not end the sleep."""
        cdef timespec request
        request.tv_sec = deadline // 1000000000
        request.tv_nsec = deadline % 1000000000
        while clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &request, NULL) == EINTR and self.caught[0] == 0:
            pass
