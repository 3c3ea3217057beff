# cython: freethreading_compatible=True
"""A recorded run as the executor meets it again: its ticks with their lateness, and what each bus received, drain by drain."""

import numpy as np

from libc.stdint cimport uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cext.abi cimport FRAME_BYTES


cdef void tape_at(void *context, int64_t now) noexcept nogil:
    """The next drain begins."""
    cdef Reel *reel = <Reel *>context
    reel.place = reel.ends[reel.next - 1] if reel.next > 0 else 0
    if reel.next < reel.count:                                 # else the recording had ended by now
        reel.next += 1
    reel.stop = reel.ends[reel.next - 1] if reel.next > 0 else 0


cdef int tape_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef Reel *reel = <Reel *>context
    cdef int64_t count = min(reel.stop - reel.place, capacity)
    memcpy(frames, reel.frames + reel.place, count * sizeof(Frame))
    reel.place += count
    return <int>count


cdef int tape_send(void *context, const Frame *frames, int count) noexcept nogil:
    return count                                               # it is in the new recording, to be compared


cdef class TapeBus:
    """A bus that gives what was received when this was recorded, and swallows what is sent.

    drains : a list, for each time that the buses were drained, of the frames that were there, each as the bytes of a struct Frame
    """

    def __cinit__(self, drains):
        cdef bytes payload
        cdef int64_t number = 0
        self.reel.count = len(drains)
        self.reel.frames = <Frame *>calloc(max(1, sum(map(len, drains))), sizeof(Frame))
        self.reel.ends = <int64_t *>calloc(max(1, len(drains)), sizeof(int64_t))
        if self.reel.frames == NULL or self.reel.ends == NULL:
            raise MemoryError
        for index, drain in enumerate(drains):
            for payload in drain:
                if len(payload) != sizeof(Frame):
                    raise ValueError("a frame has %d bytes, not %d" % (sizeof(Frame), len(payload)))
                memcpy(&self.reel.frames[number], <const char *>payload, sizeof(Frame))
                if self.reel.frames[number].length > FRAME_BYTES:
                    raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, self.reel.frames[number].length))
                number += 1
            self.reel.ends[index] = number
        self.host = BusEnd()
        self.host.bus.receive, self.host.bus.send, self.host.bus.at = tape_receive, tape_send, tape_at
        self.host.bus.context = &self.reel
        self.host.owner = self

    def __dealloc__(self):
        free(self.reel.frames)
        free(self.reel.ends)


cdef class Tape:
    """The clock of a recorded run.

    ticks : the grid points that ran
    late : ns, of each
    simulated : whether a plant stood behind the buses: time at the buses is then the grid's, not the clock's
    drained : ns from the run's begin, of each time that the buses were drained before tick 0
    """

    def __init__(self, ticks, late, bint simulated, drained=()):
        points, lateness = np.ascontiguousarray(ticks, dtype=np.int64), np.ascontiguousarray(late, dtype=np.int64)
        if points.shape != lateness.shape or points.ndim != 1 or (points < 0).any() or (np.diff(points) <= 0).any():
            raise ValueError("ticks of a recording come in order, each with its lateness")
        before = np.ascontiguousarray(drained, dtype=np.int64)
        self.keep = points, lateness, before
        self.drained, self.drains = <const int64_t *><uintptr_t>before.ctypes.data, len(before)
        self.ticks, self.late = <const int64_t *><uintptr_t>points.ctypes.data, <const int64_t *><uintptr_t>lateness.ctypes.data
        self.count, self.simulated = len(points), simulated

    cdef bint advance(self, int64_t *tick, int64_t *late) noexcept nogil:
        """The next tick and its lateness; False at the end."""
        if self.next == self.count:
            return False
        tick[0], late[0] = self.ticks[self.next], self.late[self.next]
        self.next += 1
        return True
