# cython: freethreading_compatible=True
"""In-memory bus of a simulation, behind the `Bus` struct."""

from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset

from cext.abi cimport EXTENDED, FRAME_BYTES, ID_MASK
from cext.bus.bits cimport CLASSIC_BYTES, RATE_SWITCH


cdef int memory_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef Queue *inbox = (<End *>context).inbox
    cdef int count = 0
    while count < capacity and inbox.tail != inbox.head:
        frames[count] = inbox.frames[inbox.tail % QUEUE]
        inbox.tail += 1
        count += 1
    return count


cdef int memory_send(void *context, const Frame *frames, int count) noexcept nogil:
    cdef Queue *outbox = (<End *>context).outbox
    cdef int sent = 0
    while sent < count:
        if outbox.head - outbox.tail == QUEUE:
            outbox.dropped += count - sent
            break
        outbox.frames[outbox.head % QUEUE] = frames[sent]
        outbox.head += 1
        sent += 1
    return sent


cdef class BusEnd:
    def receive(self, int most=QUEUE) -> list[tuple[int, bool, bytes, int]]:
        """Return received frames as a list of (arbitration id, is extended, data, time in ns).

        For tests and tools, not for the tick.
        """
        cdef Frame frame
        taken = []
        while len(taken) < most and self.bus.receive(self.bus.context, &frame, 1) == 1:
            taken.append((frame.id & ID_MASK, bool(frame.id & EXTENDED), bytes(frame.data[: frame.length]), frame.time))
        return taken

    def advance(self, int64_t now) -> None:
        """Set the time of a bus with its own clock, in ns of the run. For tests and tools."""
        if self.bus.at != NULL:
            self.bus.at(self.bus.context, now)

    def send(self, uint32_t arbitration_id, bytes data, bint extended=False, int64_t time=0) -> bool:
        """Send one frame. For tests and tools, not for the tick."""
        cdef Frame frame
        if len(data) > FRAME_BYTES:
            raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, len(data)))
        memset(&frame, 0, sizeof(Frame))
        frame.id = arbitration_id | (<uint32_t>EXTENDED if extended else 0)
        frame.length = <unsigned char>len(data)
        frame.time = time
        frame.flags = RATE_SWITCH if self.switching and len(data) > CLASSIC_BYTES else 0
        memcpy(frame.data, <const char *>data, len(data))
        return self.bus.send(self.bus.context, &frame, 1) == 1


cdef class MemoryBus:
    """Bus in memory: what one end sends, the other receives in order. `host` is the robot's end, `device` the
    plant's.
    """

    def __cinit__(self):
        self.queues = <Queue *>calloc(2, sizeof(Queue))
        if self.queues == NULL:
            raise MemoryError
        self.host, self.device = BusEnd(), BusEnd()
        for index, end in enumerate((self.host, self.device)):
            self._wire(end, index)

    cdef _wire(self, BusEnd end, int index):
        self.ends[index].inbox = &self.queues[index]
        self.ends[index].outbox = &self.queues[1 - index]
        end.bus.receive = memory_receive
        end.bus.send = memory_send
        end.bus.context = &self.ends[index]
        end.owner = self

    def __dealloc__(self):
        free(self.queues)

    @property
    def dropped(self) -> int:
        """Number of frames lost to a full queue."""
        return self.queues[0].dropped + self.queues[1].dropped
