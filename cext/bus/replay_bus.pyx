# cython: freethreading_compatible=True
"""Replay of a recorded run for the executor: its ticks with their lateness, and the frames that each bus received in
each drain.
"""

import numpy as np

from libc.stdint cimport uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cext.abi cimport FRAME_BYTES


cdef void replay_at(void *context, int64_t now) noexcept nogil:
    """Begin the next drain."""
    cdef ReplayBuffer *buffer = <ReplayBuffer *>context
    buffer.place = buffer.ends[buffer.next - 1] if buffer.next > 0 else 0
    if buffer.next < buffer.count:                                 # else the recording has ended
        buffer.next += 1
    buffer.stop = buffer.ends[buffer.next - 1] if buffer.next > 0 else 0


cdef int replay_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef ReplayBuffer *buffer = <ReplayBuffer *>context
    cdef int64_t count = min(buffer.stop - buffer.place, capacity)
    memcpy(frames, buffer.frames + buffer.place, count * sizeof(Frame))
    buffer.place += count
    return <int>count


cdef int replay_send(void *context, const Frame *frames, int count) noexcept nogil:
    return count                                               # recorded, for the comparison


cdef class ReplayBus:
    """Bus that returns recorded frames and discards sent ones.

    drains : for each drain of the buses, a list of the frames received, each as the bytes of a struct Frame
    """

    def __cinit__(self, drains):
        cdef bytes payload
        cdef int64_t number = 0
        self.buffer.count = len(drains)
        self.buffer.frames = <Frame *>calloc(max(1, sum(map(len, drains))), sizeof(Frame))
        self.buffer.ends = <int64_t *>calloc(max(1, len(drains)), sizeof(int64_t))
        if self.buffer.frames == NULL or self.buffer.ends == NULL:
            raise MemoryError
        for index, drain in enumerate(drains):
            for payload in drain:
                if len(payload) != sizeof(Frame):
                    raise ValueError("a frame has %d bytes, not %d" % (sizeof(Frame), len(payload)))
                memcpy(&self.buffer.frames[number], <const char *>payload, sizeof(Frame))
                if self.buffer.frames[number].length > FRAME_BYTES:
                    raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, self.buffer.frames[number].length))
                number += 1
            self.buffer.ends[index] = number
        self.host = BusEnd()
        self.host.bus.receive, self.host.bus.send, self.host.bus.at = replay_receive, replay_send, replay_at
        self.host.bus.context = &self.buffer
        self.host.owner = self

    def __dealloc__(self):
        free(self.buffer.frames)
        free(self.buffer.ends)


cdef class ReplayClock:
    """Clock of a recorded run.

    ticks : grid points that ran
    late : ns, lateness of each
    simulated : whether a plant was connected to the buses; bus time is then the grid's, not the clock's
    drained : ns from the begin of the run, of each drain before tick 0
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
        """Advance to the next tick and its lateness; False at the end."""
        if self.next == self.count:
            return False
        tick[0], late[0] = self.ticks[self.next], self.late[self.next]
        self.next += 1
        return True
