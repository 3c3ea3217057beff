# cython: freethreading_compatible=True
"""Publisher of a run: it writes the state, the rows and the events to the shared state, and waits for a reader in
virtual time.
"""

from libc.stdint cimport uintptr_t
from libc.string cimport memcpy, memset

import numpy as np

from cext.abi cimport FRAMES_PER_BATCH, FRAMES_PER_TICK, LATENESS, OK, Frame
from cext.status cimport FENCED, PAGE_LOST, PROGRAM_SILENT, UNGUARDED
from cext.clock.histogram cimport Histogram
from cext.memory.robust_mutex cimport find_dead
from cext.ring.mailbox cimport CHANGES, LETTERS, Change
from cext.ring.operator cimport NO_CONSENT, take_consent
from cext.clock.deadline_clock cimport monotonic
from cext.memory.shared_state cimport (
    FENCED_FOR_GOOD, FENCED_HERE, PAGE_SILENT, ROW, commit, load_i32, load_i64, load_u64, own, page_is_linked, reserve,
    store_i32, store_i64, store_u64, swap_i32,
)
from cext.safety.suspend cimport fence_after_suspend, suspended_since
from cext.posix cimport POLLIN, poll, pollfd
from cext.clock.signals cimport Signals
from cext.safety.thresholds cimport CONSENT_LIMIT, PAGE_SILENCE

cdef enum:
    RECENT = 6                      # rows that are kept for the report of a fault
    DRAIN_PERIOD = 50_000_000       # ns between two calls of `drain`, at most
    BACKLOG = 1 << 20               # bytes in virtual time, which the recorder must write before the run can end


cdef class Publisher:
    """Loop side of the shared state.

    Parameters
    ----------
    shared : SharedState or None; without one, nothing is published
    program : Program whose columns make a row
    virtual : the loop waits for space in a full ring instead of dropping records
    reader : file descriptor that hangs up when the reader of the shared state has ended, or -1; it ends a wait for
        space
    drain : callable that empties the ring in this process, in virtual time: called before a tick for which the ring has
        no room, and every 50 ms. An exception ends the run. None: another process empties the ring
    guard : ns of the guardian's silence that end the run, 0 without a guardian
    rows : C-contiguous float64 array (ticks, 2 + columns) for the row of every tick: tick, lateness in s, recorded
        signals; or None. A run with more ticks overwrites the first rows
    plant : Program whose columns, at the end of the tick, follow in the rows of that array; or None
    pages : whether the loss of the page of the panel that has the controls ends the run
    """

    def __init__(self, SharedState shared, Program program, bint virtual, int reader, Signals signals,
                 int64_t guard=0, rows=None, drain=None, Program plant=None, bint pages=False):
        if shared is not None and 16 * (3 + program.column_count) > <int64_t>own(shared.layout).capacity:
            raise ValueError("a ring of %d bytes cannot hold two rows of %d numbers" % (
                own(shared.layout).capacity, 2 + program.column_count))
        self.shared, self.program, self.virtual, self.reader, self.caught = shared, program, virtual, reader, signals.caught
        self.layout = NULL if shared is None else shared.layout
        self.guard, self.pages = guard, pages and shared is not None
        program.live.show(self.layout)
        self.most = 8 * (3 + program.column_count) + 2 * 16                 # a row, and two drains
        self.most += (sizeof(Frame) + 8) * (FRAMES_PER_TICK * program.devices.buses.count + 3 * FRAMES_PER_BATCH
            * program.devices.table.count)
        self.most += LETTERS * (8 + CHANGES * sizeof(Change)) + 2 * (8 + sizeof(Change))
        self.most += program.share(self.layout)
        if shared is not None:
            self.most = min(self.most, own(shared.layout).capacity // 2)          # a smaller ring drops records
        self.records = shared is not None or rows is not None
        self.drain, self.drains = drain, drain is not None and shared is not None and virtual
        self.plant = None if rows is None else plant
        self.width = 2 + program.column_count + (0 if self.plant is None else self.plant.column_count)
        self.table = np.zeros((RECENT, self.width)) if rows is None else rows
        if (self.table.ndim != 2 or len(self.table) == 0 or self.table.shape[1] != self.width
                or self.table.dtype != np.float64 or not self.table.flags.carray):
            raise ValueError("rows must be a writable C-contiguous float64 array of shape (ticks, %d)" % self.width)
        self.recent = <double *><uintptr_t>self.table.ctypes.data
        self.recent_size = len(self.table)

    def newest(self) -> list[tuple]:
        """Return the newest rows in order, each as a tuple: tick, lateness in s, recorded signals of the robot."""
        cdef int64_t row
        return [
            tuple(
                self.recent[row % self.recent_size * self.width + column]
                for column in range(2 + self.program.column_count)
            )
            for row in range(max(0, self.recent_count - min(<int64_t>RECENT, self.recent_size)), self.recent_count)
        ]

    cdef void clear(self):
        """Clear the statistics of an earlier run; the ring keeps what has not been read."""
        cdef SharedLayout *layout = self.layout
        self.recent_count = self.drained = self.link = 0
        self.error = None
        if layout == NULL:
            return
        layout.tick = -1
        layout.ticks = layout.missed = layout.dropped = layout.waited = layout.caught_up = 0
        layout.gil_taken = layout.sleeps = layout.spins = 0
        layout.frames_received = layout.frames_sent = layout.frames_foreign = layout.frames_malformed = 0
        layout.program_limit = 0
        layout.status = layout.closed = layout.hung = layout.crashed = 0
        if layout.began != 0:
            # of the previous run; a fence of another process stays, and what came before the first run
            self.lower_fence()
            layout.operator.stop = 0
        memset(layout.lost_replies, 0, sizeof(layout.lost_replies))
        memset(&layout.lateness, 0, sizeof(Histogram))
        memset(&layout.period, 0, sizeof(Histogram))
        memset(&layout.execution, 0, sizeof(Histogram))
        memset(&layout.gil, 0, sizeof(Histogram))
        memset(&layout.bus, 0, sizeof(Histogram))
        self.program.live.show(layout)

    cdef void set_state(self, int32_t state) noexcept nogil:
        if self.layout != NULL:
            store_i32(&self.layout.state, state)

    cdef void ask(self) noexcept nogil:
        """Ask the operator a new question: earlier confirmations do not count."""
        if self.layout == NULL:
            return
        self.question += 1
        self.asked = monotonic()
        store_u64(&self.layout.operator.question, self.question)

    cdef int32_t consent(self) noexcept nogil:
        """Return the origin of a confirmation of the newest question, and ask the next; NO_CONSENT without one."""
        cdef int32_t origin
        if self.layout == NULL or load_u64(&self.layout.operator.consent) == 0:
            return NO_CONSENT
        origin = take_consent(&self.layout.operator, self.question, self.asked, monotonic(), CONSENT_LIMIT)
        if origin != NO_CONSENT:
            self.ask()
        return origin

    cdef bint fenced(self) noexcept nogil:
        return self.layout != NULL and load_i32(&self.layout.fence) != 0

    cdef void beat(self, int64_t now) noexcept nogil:
        """Record that the loop is alive. now : ns of CLOCK_MONOTONIC"""
        if self.layout != NULL:
            store_i64(&self.layout.beat, now)

    cdef int attend(self, int64_t now) noexcept nogil:
        """Record that the loop is alive, and return whether it may continue: OK, FENCED, UNGUARDED, PROGRAM_SILENT or
        PAGE_LOST.

        now : ns of CLOCK_MONOTONIC
        """
        cdef bint stopped
        if self.layout == NULL:
            return OK
        stopped = self.fenced() or fence_after_suspend(self.layout)         # judged by the beat before this one
        self.beat(now)
        if stopped:
            return FENCED
        if self.guard > 0 and self.guardian_is_gone(now):
            return UNGUARDED
        if self.program_is_silent(now):
            return PROGRAM_SILENT
        return PAGE_LOST if self.pages and self.page_is_lost(now) else OK

    cdef bint program_is_silent(self, int64_t now) noexcept nogil:
        """Return whether the loop of a connected program has not passed for too long."""
        cdef int64_t limit = load_i64(&self.layout.program_limit)
        return limit > 0 and now - load_i64(&self.layout.program) > limit

    cdef bint may_arm(self, int64_t now) noexcept nogil:
        """Return whether a page has the controls, if its loss ends the run."""
        return not self.pages or page_is_linked(self.layout, now, PAGE_SILENCE)

    cdef void watch_page(self) noexcept nogil:
        """Watch the page that has the controls from now on, as long as it has them."""
        self.link = load_i64(&self.layout.page_link) or -1

    cdef bint page_is_lost(self, int64_t now) noexcept nogil:
        """Return whether the page that is watched is lost. Without a guardian, watch the first one that is linked."""
        cdef bint linked = page_is_linked(self.layout, now, PAGE_SILENCE)
        if self.link == 0:
            if self.guard == 0 and linked:
                self.watch_page()
            return False
        if linked and load_i64(&self.layout.page_link) == self.link:
            return False
        self.note_lost_page()
        return True

    cdef void note_lost_page(self) noexcept nogil:
        """Show which page was lost, and why. Behind the fence any page may be the next to be watched."""
        cdef int64_t link = load_i64(&self.layout.page_link)
        cdef bint silent = link != 0 and (link == self.link or self.fenced())
        store_i64(&self.layout.lost_page, PAGE_SILENT | <int64_t>load_i32(&self.layout.page) << 8 if silent
            else load_i64(&self.layout.page_loss))

    cdef bint guardian_is_gone(self, int64_t now) noexcept nogil:
        """Return whether the guardian is silent for too long, or its thread has died, which the kernel marks in its
        mutex.
        """
        return now - load_i64(&self.layout.guard) > self.guard or find_dead(&self.layout.guard_hold,
            &self.layout.guard_dead)

    cdef bint guardian_is_late(self) noexcept nogil:
        """Return whether drives may seem silent because the guardian, which carries their frames, is late."""
        return self.guard > 0 and (find_dead(&self.layout.guard_hold, &self.layout.guard_dead) or monotonic()
            - load_i64(&self.layout.guard) > self.guard // 2)

    cdef bint was_suspended(self) noexcept nogil:
        """Return whether the computer was suspended, or the loop paused, in the middle of a run with a guardian."""
        return self.layout != NULL and self.guard > 0 and suspended_since(self.layout) != 0

    cdef void raise_fence(self) noexcept nogil:
        if self.layout != NULL:
            swap_i32(&self.layout.fence, 0, FENCED_HERE)

    cdef bint lower_fence(self) noexcept nogil:
        """Lower the fence to arm again. Returns False if another process has raised it, which stops this run."""
        return self.layout == NULL or swap_i32(&self.layout.fence, FENCED_HERE, 0)

    cdef int attend_fenced(self, int64_t now) noexcept nogil:
        """Like `attend`, behind the loop's own fence: FENCED if another process has also raised it."""
        cdef bint stopped
        if self.layout == NULL:
            return OK
        stopped = load_i32(&self.layout.fence) == FENCED_FOR_GOOD or fence_after_suspend(self.layout)
        self.beat(now)
        if stopped:
            return FENCED
        return UNGUARDED if self.guard > 0 and self.guardian_is_gone(now) else OK

    cdef bint guardian_stops(self, int64_t now) noexcept nogil:
        """Return whether the guardian stops the actuators. now : ns of CLOCK_MONOTONIC

        A second sender would have it receive replies to questions that it has not asked.
        """
        return self.guard > 0 and load_i32(&self.layout.guard_stops) != 0 and not self.guardian_is_gone(now)

    cdef void report_hang(self, int item) noexcept nogil:
        """Report a hung tick in the shared state. item : item of the stopwatch, -1 if unknown"""
        if self.layout != NULL:
            store_i32(&self.layout.hung, 1 + item if item >= 0 else -1)

    cdef bint push_row(self, int64_t tick) noexcept nogil:
        """Write the recorded signals of this tick to the ring and the array.

        Returns False if a signal came while waiting for space.
        """
        cdef SharedLayout *layout = self.layout
        cdef int size = 2 + self.program.column_count
        cdef double *kept = self.recent + self.recent_count % self.recent_size * self.width
        cdef double *row
        cdef int64_t since
        kept[0] = <double>tick
        kept[1] = self.program.arena[LATENESS]
        self.program.record(kept + 2)
        if self.plant is not None:
            self.plant.record(kept + size)
        self.recent_count += 1
        if layout == NULL:
            return True
        row = <double *>reserve(layout, ROW, 8 * size)
        while row == NULL:
            if not self.virtual:
                layout.dropped += 1
                return True
            since = monotonic()
            if not self.wait_for_reader():
                layout.dropped += 1
                return True
            layout.waited += monotonic() - since
            if self.caught[0]:
                return False
            row = <double *>reserve(layout, ROW, 8 * size)
        memcpy(row, kept, size * sizeof(double))
        commit(layout)
        return True

    cdef bint make_room(self, bint stopping) noexcept nogil:
        """Wait, in virtual time, until the ring can take all records of one tick, so that none is dropped.

        Returns False after a signal. `stopping` ignores signals, for a second at most.
        """
        cdef SharedLayout *layout = self.layout
        cdef int64_t since
        cdef uint64_t allowed
        cdef int attempts = 1000
        if self.drains and monotonic() - self.drained > DRAIN_PERIOD and not self.drain_here():
            return stopping
        if layout == NULL or not self.virtual:
            return True
        allowed = min(own(layout).capacity - self.most, max(BACKLOG, self.most))
        if own(layout).head - load_u64(&layout.tail) <= allowed:
            return True
        if self.drains:
            return self.drain_here() or stopping
        since = monotonic()
        while own(layout).head - load_u64(&layout.tail) > allowed and self.wait_for_reader():
            attempts -= 1
            if attempts == 0 if stopping else self.caught[0] != 0 or load_u64(&layout.operator.stop) != 0:
                break
        layout.waited += monotonic() - since
        return stopping or not self.caught[0]

    cdef bint wait_for_reader(self) noexcept nogil:
        """Wait a millisecond for the recorder. Returns False if there is no recorder, or it has ended."""
        cdef pollfd ended
        if self.drains:
            return self.drain_here()
        if self.reader < 0:
            return False
        ended.fd, ended.events, ended.revents = self.reader, POLLIN, 0
        return poll(&ended, 1, 1) <= 0

    cdef bint drain_here(self) noexcept nogil:
        """Empty the ring in this process. Returns False after an exception, which `error` holds."""
        with gil:
            try:
                self.drain()
            except BaseException as error:
                self.error = error
                self.drains = False
                return False
        self.drained = monotonic()
        return True
