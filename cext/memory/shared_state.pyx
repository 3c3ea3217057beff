# cython: freethreading_compatible=True
"""Shared state from Python: created by the control process, read by the recorder."""

import os

from libc.string cimport memcpy, memset
from posix.mman cimport MAP_ANON, MAP_FAILED, MAP_FIXED, MAP_PRIVATE, MAP_SHARED, PROT_READ, PROT_WRITE, mmap, munmap
from posix.unistd cimport _SC_PAGESIZE, close, sysconf

from cext.atomics cimport load_i32_in_order, store_i32_in_order
from cext.clock.histogram cimport buckets, summary
from cext.clock.deadline_clock cimport monotonic, suspended_time
from cext.fused.locate cimport IN_RUN
from cext.ring.mailbox cimport BY_KEYS, BY_PANEL, BY_SET
from cext.ring.operator cimport origin_of_stop, process_of_stop
from cext.memory.robust_mutex cimport EDEADLK, find_dead, make_hold, pthread_mutex_trylock, pthread_mutex_unlock

from cext.ring.sealed_memory import empty_memory, seal

cdef uint64_t MAGIC = 0x314B52574B434954 + sizeof(SharedLayout)      # "TICKWRK1", and another for another layout

ORIGINS = {"set": BY_SET, "keys": BY_KEYS, "panel": BY_PANEL}
PAGE_LOSSES = ("", "silent", "closed", "cut", "taken", "returned", "ended")  # of `unlink_page` and `lost_page`
STATES = ("init", "arming", "running", "stopping", "safe", "ready", "waiting")
RECORD_ROW, RECORD_FRAME, RECORD_EVENT, RECORD_RECEIVED, RECORD_CHANGE = ROW, FRAME, EVENT, RECEIVED, CHANGE


cdef object damaged(uint64_t place):
    return ValueError("the ring of the recording is damaged at byte %d: another process has overwritten it" % place)


cdef class SharedState:
    """Memory file shared by the processes of a run.

    SharedState(capacity)                  creates it, with a ring of `capacity` bytes rounded up to a power of two
    SharedState(capacity, live=(n, text))  also with n live parameters, which the text (bytes) describes
    SharedState(capacity, empty=fd)        creates it in an empty memory file, and closes that in the end
    SharedState(fd=fd)                     maps the file behind `fd`, which another process created
    """

    def __cinit__(self, capacity=1 << 22, fd=None, live=(0, b""), empty=None):
        if fd is None:
            room = 1 << max(12, (int(capacity) - 1).bit_length())
            self.made_here = True
            self.fd = empty_memory("tickwork") if empty is None else empty
            seal(self.fd, sizeof(SharedLayout) + room + live[0] * sizeof(Shown) + len(live[1]))
            self.map_file(room, live[0], len(live[1]))
            self.layout.capacity = room
            self.layout.tick = self.layout.at = -1
            self.layout.asleep = suspended_time()
            memset(ring(self.layout), 0, room)         # touch every page before the loop does
            self.layout.control = os.getpid()
            failed = make_hold(&self.layout.hold) or make_hold(&self.layout.guard_hold)
            if failed:
                raise OSError(failed, os.strerror(failed))
            self.layout.live_count, self.layout.live_bytes = live[0], len(live[1])
            memcpy(shown(self.layout) + <int64_t>live[0], <const char *>live[1], len(live[1]))
            store_u64(&self.layout.magic, MAGIC)
        else:
            self.fd = fd
            self.map_file(0, 0, 0)

    cdef int map_file(self, uint64_t capacity, int64_t live_count, int64_t live_bytes) except -1:
        """Map the file, with private memory in front of it.

        capacity : bytes of the ring, of a file that this process has created; 0 for another, which states all three
        """
        cdef Py_ssize_t page = sysconf(_SC_PAGESIZE)
        cdef Py_ssize_t size = os.fstat(self.fd).st_size
        cdef char *begin
        cdef Own *mine
        if size <= <Py_ssize_t>sizeof(SharedLayout):
            raise ValueError("file descriptor %d is not the shared state of a run" % self.fd)
        begin = <char *>mmap(NULL, page + size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANON, -1, 0)
        if begin == MAP_FAILED:
            raise MemoryError
        mine = <Own *>(begin + page - sizeof(Own))
        mine.begin, mine.size = begin, page + size
        if mmap(begin + page, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED, self.fd, 0) == MAP_FAILED:
            munmap(begin, page + size)
            raise MemoryError
        self.layout = <SharedLayout *>(begin + page)
        if capacity == 0:
            if self.layout.magic != MAGIC:
                raise ValueError("file descriptor %d is not the shared state of a run%s" % (
                    self.fd, "" if self.layout.magic else " that is initialized"))
            capacity, live_count, live_bytes = self.layout.capacity, self.layout.live_count, self.layout.live_bytes
        if (not 4096 <= capacity <= <uint64_t>size or capacity & (capacity - 1) or not 0 <= live_count <= size
                or not 0 <= live_bytes <= size or size != <Py_ssize_t>(
                    sizeof(SharedLayout) + capacity + live_count * sizeof(Shown) + live_bytes)):
            raise ValueError("the shared state behind file descriptor %d has sizes that contradict each other" % self.fd)
        mine.capacity, mine.live_count, mine.live_bytes = capacity, live_count, live_bytes
        return 0

    def __dealloc__(self):
        if self.layout != NULL:
            self.let_go()
            if self.guarding:
                pthread_mutex_unlock(&self.layout.guard_hold)
            munmap(own(self.layout).begin, own(self.layout).size)
        if self.made_here:
            close(self.fd)

    def take_hold(self) -> None:
        """Lock the loop's mutex in the calling thread: waiters are notified when the thread dies. Raises OSError."""
        failed = pthread_mutex_trylock(&self.layout.hold)
        if failed and failed != EDEADLK:
            raise OSError(failed, "another thread holds the loop's mutex of this shared state")
        self.held = True

    def take_guard(self) -> None:
        """Lock the guardian's mutex in the calling thread: the loop detects its death at the next tick.

        Raises OSError.
        """
        failed = pthread_mutex_trylock(&self.layout.guard_hold)
        if failed and failed != EDEADLK:
            raise OSError(failed, "another guardian holds the mutex of this shared state")
        self.guarding = True

    @property
    def guardian_died(self) -> bool:
        """Return whether the thread that called `take_guard` has died."""
        return find_dead(&self.layout.guard_hold, &self.layout.guard_dead)

    cpdef let_go(self):
        """Unlock the mutex that the calling thread has locked."""
        if self.held:
            self.held = pthread_mutex_unlock(&self.layout.hold) != 0

    def push(self, uint32_t kind, bytes payload) -> None:
        """Append one record from outside the loop, padded with spaces to a multiple of 8 bytes.

        Returns False if the ring is full.
        """
        payload += b" " * ((8 - len(payload) % 8) % 8)
        if not self.made_here:                          # the process that has created the page has died
            own(self.layout).head = load_u64(&self.layout.head) & ~<uint64_t>7
        cdef void *room = reserve(self.layout, kind, <uint32_t>len(payload))
        if room == NULL:
            return False
        memcpy(room, <const char *>payload, len(payload))
        commit(self.layout)
        return True

    def drain(self, int most=4096) -> list[tuple[int, bytes]]:
        """Take up to `most` records out of the ring. Returns a list of (kind, payload in bytes)."""
        cdef SharedLayout *layout = self.layout
        cdef uint64_t head = load_u64(&layout.head)
        cdef Header header
        cdef list records = []
        self.cursor = max(self.cursor, load_u64(&layout.tail))       # another reader has taken records
        while self.cursor != head and len(records) < most:
            if not read_header(layout, self.cursor, head, &header):
                raise damaged(self.cursor)
            if header.kind != PADDING:
                records.append((header.kind, (<char *>record_at(layout, self.cursor) + sizeof(Header))[:header.bytes]))
            self.cursor += sizeof(Header) + header.bytes
            store_u64(&layout.tail, self.cursor)
        return records

    def release(self) -> None:
        """Free the space of all drained records."""
        store_u64(&self.layout.tail, self.cursor)

    def rewind(self) -> None:
        """Make records that were drained but not released available again."""
        self.cursor = self.layout.tail

    @property
    def tail(self) -> int:
        """Bytes of the ring that have been released."""
        return load_u64(&self.layout.tail)

    @property
    def cursor(self) -> int:
        """Bytes of the ring that have been drained here."""
        return self.cursor

    @property
    def held(self) -> float:
        """Fraction of the ring that was drained but not released."""
        return (self.cursor - self.layout.tail) / <double>own(self.layout).capacity

    def raise_fence(self) -> None:
        """Raise the fence permanently: no process of this run sends command frames from now on."""
        store_i32_in_order(&self.layout.fence, FENCED_FOR_GOOD)

    @property
    def sending(self) -> bool:
        """Whether the loop has checked the fence and may be sending commands, or has died or was suspended there."""
        return load_i32_in_order(&self.layout.sending) != 0

    @property
    def stopped_by(self) -> str:
        """Origin of the request to end the run: "keys", "page" and its number, or "set" and the ID of its process.

        "" without a request.
        """
        cdef uint64_t stop = load_u64(&self.layout.operator.stop)
        if stop == 0:
            return ""
        names = {BY_KEYS: "keys", BY_PANEL: "page %d" % process_of_stop(stop)}
        return names.get(origin_of_stop(stop)) or "set %d" % process_of_stop(stop)

    @property
    def question(self) -> int:
        """Number of the newest question to the operator: whether to arm a robot that is ready, or again after a fault."""
        return load_u64(&self.layout.operator.question)

    def watch_program(self, int64_t limit, int64_t now) -> None:
        """Record a pass of a connected program's loop. The run ends if the next one takes longer than `limit`.

        limit : ns; 0 ends the watch; now : ns of CLOCK_MONOTONIC
        """
        store_i64(&self.layout.program, now)
        store_i64(&self.layout.program_limit, limit)

    def link_page(self, int32_t page, int64_t beat) -> None:
        """Show that a page of the panel has the controls and has confirmed values.

        page : its number; beat : ns of CLOCK_MONOTONIC of these values
        """
        self.layout.page, self.layout.page_process = page, os.getpid()
        store_i64(&self.layout.page_beat, beat)
        store_i64(&self.layout.page_link, monotonic())

    def beat_page(self, int64_t beat) -> None:
        """Record that the page with the controls has confirmed newer values. beat : as in `link_page`"""
        store_i64(&self.layout.page_beat, beat)

    def unlink_page(self, str why, int32_t page, int32_t taker=0) -> None:
        """Show that the page with the controls has lost them.

        why : one of PAGE_LOSSES; page : its number; taker : number of the page that has taken them, 0 for none
        """
        store_i64(&self.layout.page_loss, PAGE_LOSSES.index(why) | page << 8 | <int64_t>taker << 32)
        store_i64(&self.layout.page_link, 0)

    def page_linked(self, int64_t limit) -> bool:
        """Return whether a page has the controls, and has confirmed values that are at most `limit` ns old."""
        return page_is_linked(self.layout, monotonic(), limit)

    @property
    def lost_page(self) -> tuple[int, str, int]:
        """The page whose loss the loop has found: (its number, one of PAGE_LOSSES, number of the page that took over)."""
        cdef int64_t lost = load_i64(&self.layout.lost_page)
        why = lost & 0xFF
        return lost >> 8 & 0xFFFFFF, PAGE_LOSSES[why] if why < len(PAGE_LOSSES) else "", lost >> 32

    @property
    def page_process(self) -> int:
        """ID of the process of the panel that has shown the newest page with the controls."""
        return load_i64(&self.layout.page_process)

    def look_after(self, int64_t now) -> None:
        """Record a check of the guardian. now : ns of CLOCK_MONOTONIC; 0 when it ends"""
        store_i64(&self.layout.guard, now)

    def show_stop(self, bint stops) -> None:
        """Show whether the guardian, which calls it, stops the actuators and judges their replies."""
        store_i32(&self.layout.guard_stops, stops)

    @property
    def guarded(self) -> int:
        """ns of CLOCK_MONOTONIC of the guardian's newest check; 0 without one."""
        return load_i64(&self.layout.guard)

    @property
    def beat(self) -> int:
        """ns of CLOCK_MONOTONIC at which the loop's newest round of arming, tick, or round of the safe stop began."""
        return load_i64(&self.layout.beat)

    def close(self) -> None:
        """Announce that no further records follow."""
        store_i32(&self.layout.closed, 1)

    @property
    def closed(self) -> bool:
        """Whether no further records follow."""
        return load_i32(&self.layout.closed) != 0

    @property
    def fenced(self) -> bool:
        """Whether the fence is raised."""
        return load_i32(&self.layout.fence) != 0

    @property
    def hung(self) -> int | None:
        """Stopwatch item in which a tick hung or the process crashed, -1 if unknown; None without either."""
        cdef int32_t hung = load_i32(&self.layout.hung)
        return None if hung == 0 else max(hung - 1, -1)

    @property
    def at(self) -> int:
        """Stopwatch item that the loop executes, or the first of the run that it executes; -1 if unknown."""
        return max(load_i32(&self.layout.at), -1) & ~IN_RUN

    @property
    def in_run(self) -> bool:
        """Whether the loop executes a run of machine code, of which `at` is the first step."""
        return load_i32(&self.layout.at) >= IN_RUN

    @property
    def out(self) -> int:
        """Drives that are taken out and not damped any more: bit k for device k of the schedule."""
        return sum(<object>load_u64(&self.layout.out[word]) << 64 * word for word in range(OUT_WORDS))

    @property
    def crashed(self) -> int:
        """Number of a fatal signal of the control process, 0 without one."""
        return load_i32(&self.layout.crashed)

    @property
    def state(self) -> str:
        """State of the life cycle, one of STATES: "running" if a defective process has overwritten it."""
        cdef int32_t state = load_i32(&self.layout.state)
        return STATES[state if 0 <= state < len(STATES) else RUNNING]

    @property
    def empty(self) -> bool:
        """Whether all records have been released."""
        return load_u64(&self.layout.head) == load_u64(&self.layout.tail)

    def statistics(self) -> dict[str, Any]:
        """Return a dict of all counts: ticks, missed, dropped, frames, and percentiles in s of

        lateness    of the wake-up after its grid point, which is the one after the previous tick
        period      |from one wake-up to the next - one period|
        execution   of a tick
        gil         waits for the GIL, in real time
        bus         receiving and sending, in real time
        """
        cdef SharedLayout *layout = self.layout
        return {
            "ticks": load_i64(&layout.ticks),
            "last_tick": load_i64(&layout.tick),
            "missed": load_i64(&layout.missed),
            "dropped": load_i64(&layout.dropped),
            "frames": {
                "received": load_i64(&layout.frames_received),
                "sent": load_i64(&layout.frames_sent),
                "foreign": load_i64(&layout.frames_foreign),
                "malformed": load_i64(&layout.frames_malformed),
            },
            "waited_for_recorder": load_i64(&layout.waited) * 1e-9,
            "busy": load_i64(&layout.execution.total) * 1e-9,
            "gil_taken": load_i64(&layout.gil_taken),
            "sleeps": load_i64(&layout.sleeps),
            "spins": load_i64(&layout.spins),
            "caught_up": load_i64(&layout.caught_up),
            "lateness": summary(&layout.lateness),
            "period": summary(&layout.period),
            "execution": summary(&layout.execution),
            "gil": summary(&layout.gil),
            "bus": summary(&layout.bus),
        }

    def lost_replies(self, devices: list[int]) -> list[int]:
        """Return for each of these devices of the schedule the commands without a reply before the next one."""
        return [load_i64(&self.layout.lost_replies[<int>device % DEVICE_LIMIT]) for device in devices]

    def counts(self, str name) -> np.ndarray:
        """Return the bucket counts of a histogram, as an array like that of cext.clock.histogram.counts_of."""
        if name == "lateness":
            return buckets(&self.layout.lateness)
        if name == "period":
            return buckets(&self.layout.period)
        raise KeyError(name)

    @property
    def control(self) -> int:
        """ID of the control process."""
        return self.layout.control

    @property
    def live(self) -> bytes:
        """Description of the live parameters, as bytes."""
        return (<char *>(shown(self.layout) + own(self.layout).live_count))[: own(self.layout).live_bytes]

    def live_values(self) -> list[tuple[float, float]]:
        """Return (value in the newest tick, target) of each live parameter."""
        cdef Shown *values = shown(self.layout)
        return [(values[index].value, values[index].target) for index in range(own(self.layout).live_count)]

    @property
    def wall(self) -> int:
        """ns of CLOCK_REALTIME of the start of the run; 0 before it."""
        return load_i64(&self.layout.wall)

    @property
    def began(self) -> int:
        """ns of CLOCK_MONOTONIC of the start of the run; 0 before it."""
        return load_i64(&self.layout.began)

    @property
    def first_tick(self) -> int:
        """ns from the start of the run to tick 0."""
        return load_i64(&self.layout.first_tick)
