# cython: freethreading_compatible=True
"""Overrun policy: whether a tick that is due later than its grid point runs late, skips, or ends the run."""

import re

cimport cython
from libc.stdlib cimport calloc, free
from libc.string cimport memset

NUMBER_LIMIT = 1000000
POLICIES = "skip, catch-up:N, fault:N or fault:N/WINDOW"


@cython.final
cdef class Overrun:
    """Overrun policy from comma-separated words.

    skip             the tick that is due runs next; those between are missed. This is the default
    catch-up:N       up to N ticks run late, back to back; the rest is skipped
    fault:N          N missed grid points in a row end the run
    fault:N/WINDOW   N missed among the last WINDOW grid points end the run

    Raises ValueError for any other words.
    """

    def __init__(self, str words="skip"):
        given = [word.strip() for word in words.split(",")]
        for word in given:
            found = re.fullmatch(r"skip|(catch-up|fault):([1-9][0-9]{0,6})(?:/([1-9][0-9]{0,6}))?", word)
            kind, count, window = found.groups() if found else (None, None, None)
            if not found or (kind == "catch-up" and window) or max(int(count or 0), int(window or 0)) > NUMBER_LIMIT:
                raise ValueError("unknown overrun policy %r: expected %s, with numbers from 1 to %d" % (word, POLICIES,
                    NUMBER_LIMIT))
            if word == "skip" and len(given) > 1:
                raise ValueError("the overrun policy skip cannot be combined with others. Omit it: the others skip the remaining ticks")
            if window and int(count) > int(window):
                raise ValueError("the overrun policy %s can never apply: its number exceeds its window. Use fault:N/WINDOW with N <= WINDOW" % word)
            if (self.catch_up if kind == "catch-up" else self.in_window if window else self.in_a_row if kind
                    else 0) != 0:
                raise ValueError("the overrun policy %s was given twice" % kind)
            if window:
                self.in_window, self.window = int(count), int(window)
            elif kind == "fault":
                self.in_a_row = int(count)
            elif kind:
                self.catch_up = int(count)
        self.missed = <char *>calloc(self.window + 1, 1)

    def __dealloc__(self):
        free(self.missed)

    cpdef void reset(self) noexcept nogil:
        """Forget earlier overruns."""
        self.fault = False
        self.late = self.lately = 0
        memset(self.missed, 0, self.window + 1)

    cpdef int64_t decide(self, int64_t tick, int64_t newest) noexcept nogil:
        """Return the grid point to run at, for tick `tick` when `newest` is due. `fault` is set if the run must end."""
        cdef int64_t count = newest - tick
        if count <= 0:
            self.late = 0
        elif self.late < self.catch_up:
            self.late += 1
            newest = tick
        else:
            self.late = 0
            self.remember(tick, count, 1)
            self.fault = (0 < self.in_a_row <= count) or (0 < self.in_window <= self.lately)
        self.remember(newest, 1, 0)
        return newest

    cdef void remember(self, int64_t tick, int64_t count, char missed) noexcept nogil:
        cdef int64_t point
        if self.window == 0:
            return
        for point in range(max(tick, tick + count - self.window), tick + count):
            self.lately += missed - self.missed[point % self.window]
            self.missed[point % self.window] = missed
