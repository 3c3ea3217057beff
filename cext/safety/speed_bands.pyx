# cython: freethreading_compatible=True
"""Damping in a safe stop: frames of pure damping by speed, so that damping times speed stays within the torque limit.

    note       reads the joint's velocity from a reply
    choose     the frames of the lowest band that covers |ω| + two codes + a (age + transit + 2 rounds), the highest
               possible speed until the next frame but one has arrived. A reply is as old as its frame, and the next
               frame is under way, too: transit is the time for both ways

The loop, the watchdog and the guardian use this class. Without a velocity, or with an old one, the last band applies:
it is within the limit at every speed that the drive can encode.
"""

from libc.math cimport INFINITY, fabs
from libc.stdint cimport uint32_t
from libc.stdlib cimport calloc, free

from cext.abi cimport Frame
from cext.bus.batch cimport load_batch
from cext.safety.reply_field cimport fill_frame, find_pattern, load_field, load_patterns, read_field


cdef class SpeedBands:
    """Damping of one device. Times are ns of any one clock.

    Parameters
    ----------
    bands : (highest speed in rad/s, frames as (arbitration id, is extended, data)) in ascending order; the last speed
        is infinite
    round : ns between frames
    acceleration : rad/s², upper bound of the joint's acceleration
    velocity : graph.ReplyField or an object with its attributes, or None
    transit : ns from a frame to the arrival of its reply, where it is not measured
    """

    def __init__(self, bands, int64_t round, double acceleration, velocity=None, int64_t transit=0):
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
        self.round, self.acceleration, self.transit = round, acceleration, transit
        if velocity is not None:
            self.load(velocity)
        self.forget()

    def __dealloc__(self):
        free(self.batches)
        free(self.speeds)

    cdef int load(self, velocity) except -1:
        self.pattern_count = load_patterns(self.patterns, velocity.frames)
        load_field(&self.velocity, velocity)
        return 0

    cdef void forget(self) noexcept nogil:
        self.seen = -1

    cdef bint note(self, const Frame *frame) noexcept nogil:
        """Read the velocity from a received frame. Returns False if it contains none."""
        cdef double velocity
        if find_pattern(self.patterns, self.pattern_count, frame) < 0 or not read_field(
                &self.velocity, frame, &velocity):
            return False
        self.speed = fabs(velocity)
        self.seen = frame.time
        return True

    cdef const Batch *choose(self, int64_t now, int64_t transit) noexcept nogil:
        """Return the frames to send now.

        now : ns, on the clock of the frames' times
        transit : ns, the longest measured, or `self.transit`
        """
        cdef double age, reach
        cdef int index
        if self.seen < 0:
            return &self.batches[self.count - 1]
        age = (max(now - self.seen, 0) + transit) * 1e-9
        reach = self.speed + 2.0 * self.velocity.step + self.acceleration * (age + 2e-9 * self.round)
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
        return fill_frame(&frame, identifier, data, now) and self.note(&frame)

    def frames(self, int64_t now) -> list[tuple[int, bytes]]:
        """Call `choose` from Python. Returns a list of (identifier with the flag bits of struct can_frame, data)."""
        cdef const Batch *batch = self.choose(now, self.transit)
        return [
            (batch.frames[index].id,
                bytes(batch.frames[index].data[: batch.frames[index].length])) for index in range(batch.count)]
