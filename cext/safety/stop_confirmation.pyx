# cython: freethreading_compatible=True
"""Confirmation of a safe stop by one drive: by the values in its replies, never by their number alone.

Principle
    1. A reply is at rest if its torque or current is at most `rest`, and its state bits, if the protocol has them,
       report a disabled drive. A reply that is not at rest withdraws everything.
    2. A drive that only answers is confirmed by a question and a silence: after a round, it must have sent as many
       replies as the round asks for, all at rest and from one identifier; then nothing is sent for as long again, and
       nothing may be received. A drive that reports by itself, a second drive with this id, and another node that
       sends similar frames do not stop when the questions do.
    3. The first round confirms nothing: replies to it look like replies to earlier commands, which may be under way.
    4. Frames in the silence are late replies: the lag of the last one is the time that the next round waits for its
       replies. So is a gap between replies that is longer than a round: an adapter that delivers in bursts. The silence
       lasts longer than such a gap, and begins only where a gap could be seen.
    5. A drive that may report by itself is confirmed by several consecutive reports at rest, and by the answer to
       a disable if its protocol has one. Without that answer, or with an error code in its place, the rest must last.

The loop and the guardian use this class.
"""

cimport cython
from libc.math cimport NAN, fabs

from cext.abi cimport FRAME_BYTES, ID_MASK
from cext.safety.reply_field cimport fill_frame, find_pattern, load_field, load_patterns, read_field
from cext.safety.thresholds cimport STOP_LISTEN_LIMIT, STOP_REPORTS, STOP_REST


@cython.final
cdef class StopConfirmation:
    """Confirmation by one device. Times are ns of any one clock.

    reply : graph.StopReply or an object with its attributes; None for a device that cannot confirm
    """

    def __init__(self, reply):
        self.echo_at = -1
        if reply is not None:
            self.load(reply)
        self.began = -1
        self.begin(0)

    cdef int load(self, reply) except -1:
        self.reply_count = load_patterns(self.replies, reply.frames)
        self.unasked_count = load_patterns(self.unasked, reply.unasked)
        self.length, self.rest, self.reports = reply.length, reply.rest, reply.reports
        self.has_torque = reply.torque is not None
        if self.has_torque:
            load_field(&self.torque, reply.torque)
        self.has_enabled = reply.enabled is not None
        if self.has_enabled:
            load_field(&self.enabled, reply.enabled)
        self.disabled_mask, self.disabled = reply.disabled
        self.echo_at, self.echo = reply.echo or (-1, 0)
        if not -1 <= self.echo_at < FRAME_BYTES:
            raise ValueError("a frame has no byte %d" % self.echo_at)
        return 0

    cpdef void begin(self, int64_t now, int64_t transit=0) noexcept nogil:
        """Begin a stop. transit : ns that replies to earlier commands may have been under way"""
        self.phase = SENDING
        self.began, self.transit, self.asked, self.window = now, transit, -1, 0
        self.rounds = self.wanted = self.seen = self.rest_count = self.received = 0
        self.arrived, self.gap = now, 0
        self.restless = self.echoed = self.failed = self.confirmed = False
        self.newest = NAN

    cpdef bint may_send(self) noexcept nogil:
        """Return whether the frames of the next round may be sent. False while it waits or listens."""
        return self.phase == SENDING

    cpdef void sent(self, int64_t now, int answers) noexcept nogil:
        """Note that a round was sent. answers : number of replies that it asks for"""
        self.asked, self.wanted = now, answers
        self.seen, self.source, self.gap = 0, -1, 0
        self.restless = False
        self.rounds += 1
        if self.window > 0 and not self.confirmed:                 # then a run that waits sends in every round
            self.phase, self.until = WAITING, now + self.window

    cdef bint is_at_rest(self, const Frame *frame) noexcept nogil:
        """Return whether a reply reports neither torque nor an enabled drive."""
        cdef double enabled
        if (frame.id ^ self.disabled) & self.disabled_mask & <uint32_t>ID_MASK:
            return False
        if self.has_enabled and (not read_field(&self.enabled, frame, &enabled) or not enabled <= 0.0):
            return False
        if not self.has_torque:
            return True
        if not read_field(&self.torque, frame, &self.newest):
            return False
        return fabs(self.newest) <= self.rest                      # not for NaN

    cdef bint is_reply(self, const Frame *frame) noexcept nogil:
        """Return whether a frame answers one to the device."""
        return (not self.length or frame.length == self.length) and find_pattern(
            self.replies, self.reply_count, frame) >= 0

    cdef bint note(self, const Frame *frame) noexcept nogil:
        """Note a received frame. Returns False if it is none of this device."""
        cdef int source = find_pattern(self.replies, self.reply_count, frame)
        if source < 0 and find_pattern(self.unasked, self.unasked_count, frame) < 0:
            return False
        if self.length and frame.length != self.length:
            return False
        if self.is_at_rest(frame):
            self.note_rest(frame, source)
        else:
            self.restless, self.confirmed, self.rest_count = True, False, 0
            self.echoed = self.failed = False
            if self.phase != SENDING:
                self.phase, self.window = SENDING, 0
        if source >= 0:
            self.received += 1
            self.gap = max(self.gap, frame.time - self.arrived)
            self.arrived = frame.time
        return True

    cdef void note_rest(self, const Frame *frame, int source) noexcept nogil:
        """Note a reply at rest. source : index of its pattern, below 0 for a report that is not a reply"""
        cdef int64_t lag
        if self.rest_count == 0:
            self.rest_since = frame.time
        self.rest_count += 1
        if self.echo_at >= 0 and self.echo_at < frame.length:
            self.failed = frame.data[self.echo_at] != 0 and frame.data[self.echo_at] != self.echo
            self.echoed |= frame.data[self.echo_at] == self.echo
        if source < 0:
            return
        self.restless |= self.source >= 0 and source != self.source
        self.source = source
        self.seen += 1
        if self.phase == LISTENING:
            lag = max(frame.time - self.asked, 0)
            self.last, self.window = frame.time, max(self.window, min(lag + lag // 2, STOP_LISTEN_LIMIT))

    cpdef bint judge(self, int64_t now, int64_t round) noexcept nogil:
        """Judge at the end of a round, before the next one. Returns whether the stop is confirmed.

        round : ns between rounds
        """
        if self.confirmed or self.asked < 0:
            return self.confirmed
        if self.reports:
            self.confirmed = self.rest_count >= STOP_REPORTS and (
                self.echoed or ((self.echo_at < 0 or self.failed) and now - self.rest_since >= STOP_REST))
        else:
            self.judge_answers(now, round)
        return self.confirmed

    cdef void judge_answers(self, int64_t now, int64_t round) noexcept nogil:
        cdef int64_t slack = round // 4                            # rounds begin late at times
        if self.phase == LISTENING:
            if self.last < 0 and now + slack >= self.until:
                self.phase, self.confirmed = SENDING, True
            elif self.last >= 0 and now - self.last >= round + round // 2:
                self.phase = SENDING
            elif now - self.listened >= STOP_LISTEN_LIMIT and now + slack >= self.until:
                self.phase, self.window = SENDING, 0
        elif self.phase == SENDING or now + slack >= self.until:
            self.phase = SENDING
            if round + slack < self.gap <= STOP_LISTEN_LIMIT:      # after a longer one, a bus has returned
                self.window = max(self.window, min(self.gap + self.gap // 2, STOP_LISTEN_LIMIT))
            if (self.rounds > 1 and self.seen == self.wanted and not self.restless
                    and (self.received > self.seen or round >= STOP_LISTEN_LIMIT)
                    and self.asked - self.began >= self.transit):
                self.phase, self.last, self.listened = LISTENING, -1, now
                self.until = now + max(self.window, round)

    def note_frame(self, uint32_t identifier, bytes data, int64_t now) -> bool:
        """Call `note` from Python.

        identifier : with the flag bits of struct can_frame
        now : ns, arrival of the frame
        """
        cdef Frame frame
        return fill_frame(&frame, identifier, data, now) and self.note(&frame)
