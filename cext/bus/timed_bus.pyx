# cython: freethreading_compatible=True
"""In-memory bus with a bitrate: frames take the time of their bits, one at a time, with the lowest identifier first.

The host's end is one node with one queue, which sends frames in order. At the other end each identifier is a separate
node, as drives are. Time is that of the run, which the executor passes before it receives; a frame in transmission is
completed.

SlowBus limits a faster bus: frames of the other side wait for the time that a wire of that bitrate would take.
"""

from libc.math cimport llround
from libc.stdint cimport int64_t, uint64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memmove

from cext.abi cimport EXTENDED, FRAMES_PER_TICK, ID_MASK
from cext.bus.bits cimport bits_of


cdef inline uint64_t rank(const Frame *frame) noexcept nogil:
    """Return the arbitration rank: the lowest wins, and a standard frame wins against an extended one with equal
    first eleven bits.
    """
    if frame.id & EXTENDED:
        return <uint64_t>(frame.id & ID_MASK) << 1 | 1
    return <uint64_t>(frame.id & 0x7FF) << 19


cdef int chosen(const Wire *wire, int side, int64_t instant) noexcept nogil:
    """Return the index of the frame that this end offers at an instant, or -1."""
    cdef int index
    cdef int best = -1
    for index in range(wire.count[side] if side == DEVICE else min(wire.count[side], 1)):
        if wire.waiting[side][index].time <= instant and (
                best < 0 or rank(&wire.waiting[side][index]) < rank(&wire.waiting[side][best])):
            best = index
    return best


cdef int64_t earliest(const Wire *wire) noexcept nogil:
    """Return the ns from which any frame can be sent; below 0 if there is none."""
    cdef int side, index
    cdef int64_t found = -1
    for side in range(2):
        for index in range(wire.count[side] if side == DEVICE else min(wire.count[side], 1)):
            if found < 0 or wire.waiting[side][index].time < found:
                found = wire.waiting[side][index].time
    return found


cdef void advance(Wire *wire, int64_t now) noexcept nogil:
    """Send all frames that begin before `now`. Frames given at `now` still take part in its arbitration."""
    cdef int64_t start
    cdef int side, mine, theirs
    wire.now = max(wire.now, now)
    while wire.count[HOST] or wire.count[DEVICE]:
        start = max(earliest(wire), wire.free)
        if start >= wire.now:
            break
        mine, theirs = chosen(wire, HOST, start), chosen(wire, DEVICE, start)
        side = HOST if theirs < 0 or (mine >= 0
            and rank(&wire.waiting[HOST][mine]) <= rank(&wire.waiting[DEVICE][theirs])) else DEVICE
        carry(wire, side, mine if side == HOST else theirs, start)


cdef void carry(Wire *wire, int side, int place, int64_t start) noexcept nogil:
    cdef Queue *arrived = &wire.arrived[1 - side]
    cdef Frame *frame = &wire.waiting[side][place]
    wire.free = start + llround(bits_of(frame, wire.ratio) * wire.bit)
    wire.busy += wire.free - start
    wire.carried += 1
    if arrived.head - arrived.tail == QUEUE:
        wire.dropped += 1
    else:
        arrived.frames[arrived.head % QUEUE] = frame[0]
        arrived.frames[arrived.head % QUEUE].time = wire.free
        arrived.head += 1
    wire.count[side] -= 1
    memmove(frame, frame + 1, (wire.count[side] - place) * sizeof(Frame))


cdef int take(Wire *wire, int side, Frame *frames, int capacity) noexcept nogil:
    """Take the frames that have been transmitted by now."""
    cdef Queue *arrived = &wire.arrived[side]
    cdef int count = 0
    advance(wire, wire.now)
    while count < capacity and arrived.tail != arrived.head and arrived.frames[arrived.tail % QUEUE].time <= wire.now:
        frames[count] = arrived.frames[arrived.tail % QUEUE]
        arrived.tail += 1
        count += 1
    return count


cdef int give(Wire *wire, int side, const Frame *frames, int count) noexcept nogil:
    cdef int sent = 0
    while sent < count and wire.count[side] < QUEUE:
        wire.waiting[side][wire.count[side]] = frames[sent]
        wire.count[side] += 1
        sent += 1
    wire.dropped += count - sent
    return sent


cdef void clear(Wire *wire) noexcept nogil:
    cdef int side
    wire.now = wire.free = wire.busy = wire.carried = wire.dropped = 0
    for side in range(2):
        wire.count[side] = 0
        wire.arrived[side].tail = wire.arrived[side].head


cdef int wire_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    return take((<WireEnd *>context).wire, (<WireEnd *>context).side, frames, capacity)


cdef int wire_send(void *context, const Frame *frames, int count) noexcept nogil:
    return give((<WireEnd *>context).wire, (<WireEnd *>context).side, frames, count)


cdef void wire_begin(void *context, int64_t began) noexcept nogil:
    clear((<WireEnd *>context).wire)


cdef void wire_at(void *context, int64_t now) noexcept nogil:
    advance((<WireEnd *>context).wire, now)


cdef class TimedBus:
    """In-memory bus like cext.bus.memory_bus.MemoryBus, with a bitrate.

    bitrate : bit/s
    data_bitrate : bit/s of the data phase of CAN FD; 0: frames of more than eight bytes do not switch the rate
    """

    def __cinit__(self, double bitrate, double data_bitrate=0.0):
        if not 0.0 < bitrate <= 1e9:
            raise ValueError("the bitrate must be above 0 and at most 1e9 bit/s, not %r" % bitrate)
        self.wire = <Wire *>calloc(1, sizeof(Wire))
        if self.wire == NULL:
            raise MemoryError
        if data_bitrate and not bitrate <= data_bitrate <= 1e9:
            raise ValueError("the data bitrate must be from the bitrate to 1e9 bit/s, not %r" % data_bitrate)
        self.wire.bit, self.wire.ratio = 1e9 / bitrate, bitrate / data_bitrate if data_bitrate else 1.0
        self.host, self.device = BusEnd(), BusEnd()
        for index, end in enumerate((self.host, self.device)):
            self.ends[index].wire, self.ends[index].side = self.wire, index
            (<BusEnd>end).bus.receive, (<BusEnd>end).bus.send, (<BusEnd>end).bus.at = wire_receive, wire_send, wire_at
            (<BusEnd>end).bus.context = &self.ends[index]
            (<BusEnd>end).owner = self
            (<BusEnd>end).switching = data_bitrate > 0.0
        self.host.bus.begin = wire_begin

    def __dealloc__(self):
        free(self.wire)

    @property
    def dropped(self) -> int:
        """Number of frames lost to a full queue."""
        return self.wire.dropped

    @property
    def carried(self) -> int:
        """Number of transmitted frames."""
        return self.wire.carried

    @property
    def busy(self) -> float:
        """s with a frame on the wire."""
        return self.wire.busy * 1e-9


cdef int slow_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    """Put frames of the other side on the wire, send replies that have been transmitted, and receive."""
    cdef SlowEnd *slow = <SlowEnd *>context
    cdef Frame[FRAMES_PER_TICK] passing
    cdef int count = slow.real.receive(slow.real.context, passing, FRAMES_PER_TICK)
    cdef int sent
    if count < 0:
        return count
    give(slow.wire, HOST, passing, count)
    count = take(slow.wire, HOST, passing, FRAMES_PER_TICK)
    if count > 0:
        sent = slow.real.send(slow.real.context, passing, count)
        if sent < 0:
            return sent
        slow.refused += count - sent
    return take(slow.wire, DEVICE, frames, capacity)


cdef int slow_send(void *context, const Frame *frames, int count) noexcept nogil:
    return give((<SlowEnd *>context).wire, DEVICE, frames, count)


cdef void slow_begin(void *context, int64_t began) noexcept nogil:
    cdef SlowEnd *slow = <SlowEnd *>context
    clear(slow.wire)
    if slow.real.begin != NULL:
        slow.real.begin(slow.real.context, began)


cdef void slow_at(void *context, int64_t now) noexcept nogil:
    advance((<SlowEnd *>context).wire, now)


cdef class SlowBus:
    """Bus slowed down to a bitrate, for the plant at its end, with the resolution of the plant's step.

    real : BusEnd of the faster bus
    bitrate, data_bitrate : bit/s, as of a TimedBus

    end : BusEnd for the plant
    """

    def __cinit__(self, BusEnd real, double bitrate, double data_bitrate=0.0):
        self.bus, self.real, self.end = TimedBus(bitrate, data_bitrate), real, BusEnd()
        self.end.switching = data_bitrate > 0.0
        self.context.wire, self.context.real = self.bus.wire, real.bus
        self.end.bus.receive, self.end.bus.send = slow_receive, slow_send
        self.end.bus.at, self.end.bus.begin = slow_at, slow_begin
        self.end.bus.context = &self.context
        self.end.owner = self

    @property
    def refused(self) -> int:
        """Number of replies that the faster bus rejected."""
        return self.context.refused
