from libc.stdint cimport int32_t, int64_t

from cext.abi cimport FRAMES_PER_TICK, Frame
from cext.memory.shared_state cimport SharedLayout

cdef enum:
    STREAM_READS = 16            # QUEUE and the ring of a stream hold this many times FRAMES_PER_TICK

cdef class Buses:
    """Buses of one schedule, and the log of their frames."""
    cdef list ends               # BusEnd, one per bus
    cdef int count
    cdef void **buses            # the same, borrowed
    cdef int32_t *reads          # per bus: limit of reads of FRAMES_PER_TICK in one drain
    cdef Frame[FRAMES_PER_TICK] received
    cdef int failed              # index of the bus that failed last, -1 for other causes
    cdef int64_t began           # ns of CLOCK_MONOTONIC: zero of the frames' times
    cdef SharedLayout *layout      # for the log, and with the fence; NULL: none

    cdef void begin(self, int64_t began) noexcept nogil
    cdef void set_time(self, int bus, int64_t now) noexcept nogil
    cdef int receive(self, int bus) noexcept nogil
    cdef void discard(self) noexcept nogil
    cdef int send(self, int bus, Frame *frames, int count, int64_t now, bint stopping) noexcept nogil
    cdef int status(self, int combined, bint stopping) noexcept nogil
    cdef void log_drain(self, int64_t now) noexcept nogil
    cdef void log_frame(self, const Frame *frame) noexcept nogil
