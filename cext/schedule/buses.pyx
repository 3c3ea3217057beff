# cython: freethreading_compatible=True
"""Buses of a schedule: reads, writes, the fence, and the log of all frames in the ring."""

from libc.stdint cimport uint8_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cext.abi cimport OK
from cext.status cimport BUS_ERROR, FENCED
from cext.atomics cimport load_i32_in_order, store_i32, store_i32_in_order
from cext.bus.bits cimport CLASSIC_BYTES, RATE_SWITCH
from cext.bus.memory_bus cimport BusEnd
from cext.memory.shared_state cimport FRAME, RECEIVED, commit, load_i32, reserve
from cext.safety.suspend cimport fence_after_suspend


cdef class Buses:
    """Buses of a `graph.Schedule`.

    Parameters
    ----------
    schedule : graph.Schedule
    ends : BusEnd, one for each of schedule.buses
    """

    def __init__(self, schedule, ends):
        if len(ends) != len(schedule.buses):
            raise ValueError("the schedule has %d buses, but %d bus ends were given" % (len(schedule.buses), len(ends)))
        self.ends = list(ends)
        self.count = len(ends)
        self.failed = -1
        self.layout = NULL
        self.buses = <void **>calloc(max(1, len(ends)), sizeof(void *))
        self.reads = <int32_t *>calloc(max(1, len(ends)), sizeof(int32_t))
        for index, (end, medium) in enumerate(zip(self.ends, schedule.media)):
            self.buses[index] = <void *>(<BusEnd?>end)
            self.reads[index] = 1 if medium == "can" else STREAM_READS

    def __dealloc__(self):
        free(self.buses); free(self.reads)

    cdef void begin(self, int64_t began) noexcept nogil:
        """Set the zero of the frames' times of all buses, in ns of CLOCK_MONOTONIC."""
        cdef int bus
        self.began = began
        for bus in range(self.count):
            if (<BusEnd>self.buses[bus]).bus.begin != NULL:
                (<BusEnd>self.buses[bus]).bus.begin((<BusEnd>self.buses[bus]).bus.context, began)

    cdef void set_time(self, int bus, int64_t now) noexcept nogil:
        """Set the time of a bus without a clock of its own, in ns from the start of the run."""
        if (<BusEnd>self.buses[bus]).bus.at != NULL:
            (<BusEnd>self.buses[bus]).bus.at((<BusEnd>self.buses[bus]).bus.context, now)

    cdef int receive(self, int bus) noexcept nogil:
        """Read up to FRAMES_PER_TICK frames into `received`. Returns their number, below 0 for an error."""
        cdef int index
        cdef int count = (<BusEnd>self.buses[bus]).bus.receive((<BusEnd>self.buses[bus]).bus.context, self.received,
            FRAMES_PER_TICK)
        for index in range(count):
            self.received[index].bus = <uint8_t>bus
            self.received[index].sent = 0
        return count

    cdef void discard(self) noexcept nogil:
        """Discard the frames in all queues."""
        cdef int bus, reads
        for bus in range(self.count):
            for reads in range(64):
                if self.receive(bus) <= 0:
                    break

    cdef int send(self, int bus, Frame *frames, int count, int64_t now, bint stopping) noexcept nogil:
        """Send frames; behind the fence only those of the safe stop. stopping : whether they belong to it"""
        cdef int index
        if count == 0:
            return OK
        for index in range(count):
            frames[index].time = now
            frames[index].bus = <uint8_t>bus
            frames[index].sent = 1
            if (<BusEnd>self.buses[bus]).switching and frames[index].length > CLASSIC_BYTES:
                frames[index].flags |= RATE_SWITCH
        # the process, or the computer, may be suspended between the fence and the send: the guardian then repeats its stop
        if not stopping and self.layout != NULL:
            store_i32_in_order(&self.layout.sending, 1)
            if load_i32_in_order(&self.layout.fence) or fence_after_suspend(self.layout):
                store_i32(&self.layout.sending, 0)
                return FENCED
        count = (<BusEnd>self.buses[bus]).bus.send((<BusEnd>self.buses[bus]).bus.context, frames, count)
        if not stopping and self.layout != NULL:
            store_i32(&self.layout.sending, 0)
        if count < 0:
            self.failed = bus
            return BUS_ERROR
        if self.layout != NULL:                   # a full queue accepts fewer; only the accepted ones were sent
            self.layout.frames_sent += count
            for index in range(count):
                self.log_frame(&frames[index])
        return OK

    cdef int status(self, int combined, bint stopping) noexcept nogil:
        """Return OK, FENCED or BUS_ERROR from the combined bits of several statuses of `send`."""
        if combined == OK:
            return OK
        return FENCED if not stopping and self.layout != NULL and load_i32(&self.layout.fence) else BUS_ERROR

    cdef void log_drain(self, int64_t now) noexcept nogil:
        """Log the time of a drain of all buses, for the replay of the run."""
        cdef int64_t *room
        if self.layout == NULL or self.count == 0:
            return
        room = <int64_t *>reserve(self.layout, RECEIVED, sizeof(int64_t))
        if room == NULL:
            self.layout.dropped += 1
            return
        room[0] = now
        commit(self.layout)

    cdef void log_frame(self, const Frame *frame) noexcept nogil:
        """Log a frame. Requires a layout."""
        cdef void *room = reserve(self.layout, FRAME, sizeof(Frame))
        if room == NULL:
            self.layout.dropped += 1
            return
        memcpy(room, frame, sizeof(Frame))
        commit(self.layout)
