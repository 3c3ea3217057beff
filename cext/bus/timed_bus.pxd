from libc.stdint cimport int64_t, uint64_t

from cext.abi cimport Bus, Frame
from cext.bus.memory_bus cimport QUEUE, BusEnd, Queue

cdef enum:
    HOST, DEVICE

cdef struct Wire:
    double bit                  # ns
    double ratio                # nominal bitrate / data bitrate
    int64_t now                 # ns of the run
    int64_t free                # ns, end of the frame on the wire
    int64_t busy                # ns with a frame on the wire
    int64_t carried             # frames
    int64_t dropped             # frames lost to a full queue
    Queue arrived[2]            # at each end
    int count[2]
    Frame waiting[2][QUEUE]     # to be sent by each end, in order

cdef struct WireEnd:
    Wire *wire
    int side

cdef class TimedBus:
    cdef Wire *wire
    cdef WireEnd ends[2]
    cdef readonly BusEnd host, device

cdef struct SlowEnd:
    Wire *wire
    Bus real
    int64_t refused

cdef class SlowBus:
    cdef SlowEnd context
    cdef TimedBus bus
    cdef object real
    cdef readonly BusEnd end
