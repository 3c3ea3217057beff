# cython: freethreading_compatible=True
"""Damping in a safe stop: frames of pure damping by speed, so that damping times speed stays within the torque limit.

    note       reads the joint's velocity from a reply
    choose     the frames of the lowest band that covers |ω| + two codes + a (age + 2 rounds), the highest possible
               speed until the next frame but one

The loop, the watchdog and the guardian use this class. Without a velocity, or with an old one, the last band applies:
it is within the limit at every speed that the drive can encode.
"""

from libc.math cimport INFINITY, fabs
from libc.stdint cimport uint64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcmp, memcpy, memset

from cext.abi cimport EXTENDED, FRAME_BYTES
from cext.bus.batch cimport load_batch


cdef class SpeedBands:
    """Damping of one device. Times are ns of any one clock.

    Parameters
    ----------
    bands : (highest speed in rad/s, frames as (arbitration id, is extended, data)) in ascending order; the last speed
        is infinite
    round : ns between frames
    acceleration : rad/s², upper bound of the joint's acceleration
    velocity : graph.ReplyField or an object with its attributes, or None
    """

    def __init__(self, bands, int64_t round, double acceleration, velocity=None):
        speeds = [speed for speed, _ in bands]
        if sorted(set(speeds)) != speeds or speeds[len(speeds) - 1 :] != [INFINITY]:
            raise ValueError("bands must be in ascending order of speed and end with infinity, got %r" % (speeds,))
        if round <= 0 or not acceleration >= 0.0:
            raise ValueError("round must be above 0 ns and acceleration at least 0 rad/s², got %r and %r" % (round,
                acceleration))
        self.count = len(bands)
        self.batches = <Batch *>calloc(self.count, sizeof(Batch))
        self.speeds = <double *>calloc(self.count, sizeof(double))
        if self.batches == NULL or self.speeds == NULL:
            raise MemoryError
        for index, (speed, frames) in enumerate(bands):
            load_batch(&self.batches[index], frames)
            self.speeds[index] = speed
        self.round, self.acceleration = round, acceleration
        if velocity is not None:
            self.load(velocity)
        self.forget()

    def __dealloc__(self):
        free(self.batches)
        free(self.speeds)

    cdef int load(self, velocity) except -1:
        cdef bytes prefix
        if len(velocity.frames) > PATTERN_LIMIT:
            raise ValueError("at most %d kinds of frames contain a velocity, not %d"
                             % (PATTERN_LIMIT, len(velocity.frames)))
        if not (0 <= velocity.first and 0 < velocity.bits <= 32 and velocity.first + velocity.bits <= 8 * FRAME_BYTES):
            raise ValueError("no field of %r bits at bit %r" % (velocity.bits, velocity.first))
        self.first, self.bits, self.signed = velocity.first, velocity.bits, velocity.signed
        self.low, self.step = velocity.low, (velocity.high - velocity.low) / (2.0**velocity.bits - 1.0)
        for index, (identifier, mask, extended, first) in enumerate(velocity.frames):
            prefix = first
            if len(prefix) > PREFIX_BYTES:
                raise ValueError("at most %d first bytes identify a frame, not %d" % (PREFIX_BYTES, len(prefix)))
            self.patterns[index].id = <uint32_t>identifier | (<uint32_t>EXTENDED if extended else 0)
            self.patterns[index].mask = <uint32_t>mask | 0xE0000000u
            memcpy(self.patterns[index].prefix, <const char *>prefix, len(prefix))
            self.patterns[index].length = len(prefix)
        self.pattern_count = len(velocity.frames)
        return 0

    cdef void forget(self) noexcept nogil:
        self.seen = -1

    cdef bint note(self, const Frame *frame) noexcept nogil:
        """Read the velocity from a received frame. Returns False if it contains none."""
        cdef uint64_t code = 0
        cdef int index, last
        cdef Pattern *pattern
        for index in range(self.pattern_count):
            pattern = &self.patterns[index]
            if (frame.id ^ pattern.id) & pattern.mask == 0 and frame.length >= pattern.length and (
                    memcmp(frame.data, pattern.prefix, pattern.length) == 0):
                break
        else:
            return False
        last = self.first + self.bits                              # first bit after the field
        if 8 * <int>frame.length < last:
            return False
        for index in range(self.first // 8, (last + 7) // 8):
            code = code << 8 | frame.data[index]
        code >>= (8 - last % 8) % 8
        code &= (<uint64_t>1 << self.bits) - 1
        if self.signed:
            code ^= <uint64_t>1 << (self.bits - 1)
        self.speed = fabs(self.low + code * self.step)
        self.seen = frame.time
        return True

    cdef const Batch *choose(self, int64_t now) noexcept nogil:
        """Return the frames to send now. now : ns, on the clock of the frames' times"""
        cdef double age, reach
        cdef int index
        if self.seen < 0:
            return &self.batches[self.count - 1]
        age = max(now - self.seen, 0) * 1e-9
        reach = self.speed + 2.0 * self.step + self.acceleration * (age + 2e-9 * self.round)
        for index in range(self.count - 1):
            if reach <= self.speeds[index]:
                return &self.batches[index]
        return &self.batches[self.count - 1]

    def note_frame(self, uint32_t identifier, bytes data, int64_t now) -> bool:
        """Call `note` from Python.

        identifier : with the flag bits of struct can_frame
        now : ns, arrival of the frame
        """
        cdef Frame frame
        if len(data) > FRAME_BYTES:
            return False
        memset(&frame, 0, sizeof(Frame))
        frame.id, frame.length, frame.time = identifier, <uint8_t>len(data), now
        memcpy(frame.data, <const char *>data, len(data))
        return self.note(&frame)

    def frames(self, int64_t now) -> list[tuple[int, bytes]]:
        """Call `choose` from Python. Returns a list of (identifier with the flag bits of struct can_frame, data)."""
        cdef const Batch *batch = self.choose(now)
        return [
            (batch.frames[index].id,
                bytes(batch.frames[index].data[: batch.frames[index].length])) for index in range(batch.count)]
