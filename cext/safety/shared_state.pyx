# cython: freethreading_compatible=True
"""The shared page from Python: made by the control process, read by the recorder."""

import mmap
import os

from cpython.buffer cimport PyBUF_WRITABLE, PyObject_GetBuffer, PyBuffer_Release
from libc.string cimport memcpy, memset
from posix.unistd cimport close

from cext.clock.histogram cimport buckets, summary
from cext.safety.robust_mutex cimport EDEADLK, find_dead, make_hold, pthread_mutex_trylock, pthread_mutex_unlock

cdef uint64_t MAGIC = 0x314B52574B434954 + sizeof(PageLayout)      # "TICKWRK1", and another for another layout

STATES = ("init", "arming", "running", "stopping", "safe", "ready", "waiting")
RECORD_ROW, RECORD_FRAME, RECORD_EVENT, RECORD_RECEIVED, RECORD_CHANGE = ROW, FRAME, EVENT, RECEIVED, CHANGE


cdef class Page:
    """One memory file shared by the processes of a run.

    Page(capacity)                  makes it, with a ring of `capacity` bytes rounded up to a power of two
    Page(capacity, live=(n, text))  the same with room for n live parameters, which the text (bytes) describes
    Page(fd=fd)                     maps the one behind `fd`, which another process made
    """

    def __cinit__(self, capacity=1 << 22, fd=None, live=(0, b"")):
        cdef Py_buffer buffer
        if fd is None:
            room = 1 << max(12, (int(capacity) - 1).bit_length())
            self.fd = fd = os.memfd_create("tickwork")
            self.made_here = True
            os.ftruncate(fd, sizeof(PageLayout) + room + live[0] * sizeof(Shown) + len(live[1]))
        self.fd = fd
        self.memory = mmap.mmap(fd, 0)
        if len(self.memory) <= <Py_ssize_t>sizeof(PageLayout):
            raise ValueError("file descriptor %d does not hold a Tickwork page" % fd)
        PyObject_GetBuffer(self.memory, &buffer, PyBUF_WRITABLE)
        self.layout = <PageLayout *>buffer.buf
        PyBuffer_Release(&buffer)                  # self.memory stays mapped as long as this object lives
        if self.layout.magic == 0:
            if not self.made_here:
                raise ValueError("file descriptor %d holds a Tickwork page that is still being made" % fd)
            self.layout.capacity = room
            self.layout.tick = -1
            memset(ring(self.layout), 0, self.layout.capacity)     # the loop is not to be the first to touch it
            self.layout.control = os.getpid()
            failed = make_hold(&self.layout.hold) or make_hold(&self.layout.guard_hold)
            if failed:
                raise OSError(failed, os.strerror(failed))
            self.layout.live_count, self.layout.live_bytes = live[0], len(live[1])
            self.memory[len(self.memory) - len(live[1]) :] = live[1]
            store_u64(&self.layout.magic, MAGIC)
        elif self.layout.magic != MAGIC:
            raise ValueError("file descriptor %d does not hold a Tickwork page" % fd)

    def __dealloc__(self):
        self.let_go()
        if self.guarding:
            pthread_mutex_unlock(&self.layout.guard_hold)
        if self.made_here:
            close(self.fd)

    def take_hold(self):
        """The calling thread is there as long as it lives, or lets go: whoever waits for its hold is told when it dies. OSError"""
        failed = pthread_mutex_trylock(&self.layout.hold)
        if failed and failed != EDEADLK:
            raise OSError(failed, "somebody else has the hold on this page")
        self.held = True

    def take_guard(self):
        """The calling thread is the guardian's: the loop sees at its next tick when this thread dies. OSError"""
        failed = pthread_mutex_trylock(&self.layout.guard_hold)
        if failed and failed != EDEADLK:
            raise OSError(failed, "another guardian is on this page")
        self.guarding = True

    @property
    def guardian_died(self):
        """Whether the thread that took guard has died. From then on for good."""
        return find_dead(&self.layout.guard_hold, &self.layout.guard_dead)

    cpdef let_go(self):
        """Nobody is told any more. Of the thread that took hold."""
        if self.held:
            self.held = pthread_mutex_unlock(&self.layout.hold) != 0

    def push(self, uint32_t kind, bytes payload):
        """Append one record from outside the loop, padded with spaces to a multiple of 8 bytes. False: there is no room for it now."""
        payload += b" " * ((8 - len(payload) % 8) % 8)
        cdef void *room = reserve(self.layout, kind, <uint32_t>len(payload))
        if room == NULL:
            return False
        memcpy(room, <const char *>payload, len(payload))
        commit(self.layout)
        return True

    def drain(self, int most=4096, bint release=True):
        """Take up to `most` records out of the ring: a list of (kind, payload) with the payload as bytes.

        Without `release` their room is not given back before `release()`: a reader that comes after this one finds them again.
        """
        cdef PageLayout *page = self.layout
        cdef uint64_t head = load_u64(&page.head)
        cdef Header *header
        cdef list records = []
        if self.cursor < page.tail:                     # another reader was here
            self.cursor = page.tail
        while self.cursor != head and len(records) < most:
            header = <Header *>(ring(page) + (self.cursor & (page.capacity - 1)))
            if header.kind != PADDING:
                records.append((header.kind, (<char *>header + sizeof(Header))[:header.bytes]))
            self.cursor += sizeof(Header) + header.bytes
            if release:
                store_u64(&page.tail, self.cursor)
        return records

    def release(self):
        """Give back the room of everything that was drained."""
        store_u64(&self.layout.tail, self.cursor)

    def rewind(self):
        """Drain again what was drained and not released."""
        self.cursor = self.layout.tail

    @property
    def tail(self):
        """Bytes of the ring that have been given back."""
        return load_u64(&self.layout.tail)

    @property
    def cursor(self):
        """Bytes of the ring that have been drained here."""
        return self.cursor

    @property
    def held(self):
        """Share of the ring that was drained and not released."""
        return (self.cursor - self.layout.tail) / <double>self.layout.capacity

    def raise_fence(self):
        """From now on no process of this run sends a command frame. There is no way back."""
        store_i32(&self.layout.fence, FENCED_FOR_GOOD)

    def look_after(self, int64_t now):
        """The guardian is there. now : ns, CLOCK_MONOTONIC; 0 when it leaves"""
        store_i64(&self.layout.guard, now)

    @property
    def guarded(self):
        """ns, CLOCK_MONOTONIC of the guardian's newest look; 0 while there is none."""
        return load_i64(&self.layout.guard)

    @property
    def beat(self):
        """ns, CLOCK_MONOTONIC at which the loop's newest round of arming, tick, or round of the safe stop began."""
        return load_i64(&self.layout.beat)

    def close(self):
        """Say that nothing will be pushed any more."""
        store_i32(&self.layout.closed, 1)

    @property
    def closed(self):
        return load_i32(&self.layout.closed) != 0

    @property
    def fenced(self):
        return load_i32(&self.layout.fence) != 0

    @property
    def hung(self):
        """Item of cext.clock.stopwatch with which a tick hung or the process crashed, -1 where that is not known; None while none did."""
        cdef int32_t hung = load_i32(&self.layout.hung)
        return None if hung == 0 else max(hung - 1, -1)

    @property
    def crashed(self):
        """Number of the signal that kills the control process from within, 0 while there is none."""
        return load_i32(&self.layout.crashed)

    @property
    def state(self):
        return STATES[load_i32(&self.layout.state)]

    @property
    def empty(self):
        return load_u64(&self.layout.head) == load_u64(&self.layout.tail)

    def statistics(self):
        """A dict of everything the page counts: ticks, missed, dropped, frames, and percentiles in s of

        lateness    of the wake-up behind the grid point that was awaited, which is the one after the tick before
        period      |from one wake-up to the next - one period|
        execution   of a tick
        gil         waits for the GIL, in real time
        bus         receiving and sending, in real time
        """
        cdef PageLayout *page = self.layout
        return {
            "ticks": load_i64(&page.ticks),
            "last_tick": load_i64(&page.tick),
            "missed": load_i64(&page.missed),
            "dropped": load_i64(&page.dropped),
            "frames": {
                "received": load_i64(&page.frames_received),
                "sent": load_i64(&page.frames_sent),
                "foreign": load_i64(&page.frames_foreign),
                "malformed": load_i64(&page.frames_malformed),
            },
            "waited_for_recorder": load_i64(&page.waited) * 1e-9,
            "busy": load_i64(&page.execution.total) * 1e-9,
            "gil_taken": load_i64(&page.gil_taken),
            "sleeps": load_i64(&page.sleeps),
            "spins": load_i64(&page.spins),
            "caught_up": load_i64(&page.caught_up),
            "lateness": summary(&page.lateness),
            "period": summary(&page.period),
            "execution": summary(&page.execution),
            "gil": summary(&page.gil),
            "bus": summary(&page.bus),
        }

    def counts(self, str name):
        """The buckets of one of the histograms, to be added up over runs: an array, as cext.clock.histogram.counts_of makes it."""
        if name == "lateness":
            return buckets(&self.layout.lateness)
        if name == "period":
            return buckets(&self.layout.period)
        raise KeyError(name)

    @property
    def control(self):
        """Number of the control process."""
        return self.layout.control

    @property
    def live(self):
        """What describes the live parameters, as it was given."""
        return self.memory[len(self.memory) - self.layout.live_bytes :]

    def live_values(self):
        """Of each live parameter (its value in the latest tick, where it is going)."""
        cdef Shown *values = shown(self.layout)
        return [(values[index].value, values[index].target) for index in range(self.layout.live_count)]

    @property
    def wall(self):
        """ns, CLOCK_REALTIME of the run's begin; 0 before it."""
        return load_i64(&self.layout.wall)

    @property
    def began(self):
        """ns, CLOCK_MONOTONIC of the run's begin; 0 before it."""
        return load_i64(&self.layout.began)

    @property
    def first_tick(self):
        """ns from the run's begin to tick 0."""
        return load_i64(&self.layout.first_tick)
