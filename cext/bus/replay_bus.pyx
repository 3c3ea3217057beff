# cython: freethreading_compatible=True
"""Replay of a recorded run for the executor, in blocks: its ticks with their lateness, and the frames that each bus
received in each drain.
"""

import numpy as np

from libc.stdint cimport uintptr_t
from libc.string cimport memcpy

from cext.abi cimport FRAME_BYTES


cdef void replay_at(void *context, int64_t now) noexcept nogil:
    """Begin the next drain. One that is not in the present block has no frames."""
    cdef ReplayBuffer *buffer = <ReplayBuffer *>context
    cdef int64_t index
    buffer.drain += 1
    index = buffer.drain - buffer.first
    buffer.place = buffer.stop = 0
    if 0 <= index < buffer.count:
        buffer.place = buffer.ends[index - 1] if index > 0 else 0
        buffer.stop = buffer.ends[index]


cdef int replay_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef ReplayBuffer *buffer = <ReplayBuffer *>context
    cdef int64_t count = min(buffer.stop - buffer.place, capacity)
    memcpy(frames, buffer.frames + buffer.place, count * sizeof(Frame))
    buffer.place += count
    return <int>count


cdef int replay_send(void *context, const Frame *frames, int count) noexcept nogil:
    return count                                               # recorded, for the comparison


cdef class ReplayBus:
    """Bus that returns recorded frames and discards sent ones."""

    def __cinit__(self):
        self.host = BusEnd()
        self.host.bus.receive, self.host.bus.send, self.host.bus.at = replay_receive, replay_send, replay_at
        self.host.bus.context = &self.buffer
        self.host.owner = self

    def give(self, frames, drains):
        """Replace the block of received frames.

        frames : uint8 array (n, bytes of a struct Frame)
        drains : int64 array (n,), in ascending order: number of the bus drain that returned each; the first drain of
            the recording is 1

        Raises ValueError for a frame that is none.
        """
        cdef const Frame *all
        cdef int64_t index
        block = np.ascontiguousarray(frames, dtype=np.uint8)
        numbers = np.ascontiguousarray(drains, dtype=np.int64)
        if block.ndim != 2 or block.shape[1] != sizeof(Frame) or len(block) != len(numbers):
            raise ValueError("expected frames of the shape (%d, %d), got %r" % (len(numbers), sizeof(Frame),
                block.shape))
        all = <const Frame *><uintptr_t>block.ctypes.data
        for index in range(len(numbers)):
            if all[index].length > FRAME_BYTES:
                raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, all[index].length))
        if (np.diff(numbers) < 0).any():
            raise ValueError("the bus drains of a recording must be in ascending order")
        self.buffer.first = numbers[0] if len(numbers) else 0
        ends = np.cumsum(np.bincount(numbers - self.buffer.first)) if len(numbers) else np.empty(0)
        ends = np.ascontiguousarray(ends, dtype=np.int64)
        self.keep = block, ends
        self.buffer.frames, self.buffer.ends = all, <const int64_t *><uintptr_t>ends.ctypes.data
        self.buffer.count = len(ends)


cdef class ReplayClock:
    """Clock of a recorded run.

    refill : called at the end of a block; it calls `give` and returns True, or False at the end of the recording. Its
        exception ends the run and is then raised by the executor
    simulated : whether a plant was connected to the buses; bus time is then the grid's, not the clock's
    drained : ns from the start of the run, of each drain before tick 0
    confirmed : number of drains before the operator confirmed; -1 for a run without a confirmation
    """

    def __init__(self, refill, bint simulated, drained=(), confirmed=-1):
        before = np.ascontiguousarray(drained, dtype=np.int64)
        self.refill, self.before, self.simulated, self.confirmed = refill, before, simulated, confirmed
        self.drained, self.drains = <const int64_t *><uintptr_t>before.ctypes.data, len(before)

    def give(self, ticks, late):
        """Replace the block of ticks.

        ticks : grid points that ran
        late : ns, lateness of each
        """
        points = np.ascontiguousarray(ticks, dtype=np.int64)
        lateness = np.ascontiguousarray(late, dtype=np.int64)
        newest = self.ticks[self.count - 1] if self.count else -1
        if points.shape != lateness.shape or points.ndim != 1 or (np.diff(points, prepend=newest) <= 0).any():
            raise ValueError("the ticks of a recording must increase, and each must have a lateness")
        self.keep = points, lateness
        self.ticks = <const int64_t *><uintptr_t>points.ctypes.data
        self.late = <const int64_t *><uintptr_t>lateness.ctypes.data
        self.count, self.next = len(points), 0

    cdef bint advance(self, int64_t *tick, int64_t *late) noexcept nogil:
        """Advance to the next tick and its lateness; False at the end."""
        if self.next == self.count and not self.refilled():
            return False
        tick[0], late[0] = self.ticks[self.next], self.late[self.next]
        self.next += 1
        return True

    cdef bint refilled(self) noexcept nogil:
        """Fetch the next block. Returns False at the end, or after an exception, which `error` holds."""
        with gil:
            try:
                while self.next == self.count:
                    if not self.refill():
                        return False
                return True
            except BaseException as error:
                self.error = error
                return False
