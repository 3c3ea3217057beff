"""Lines: buses that another process owns, with a ring of frames in each direction.

Each ring has one writing and one reading process, and no locks.
"""

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.abi cimport Frame
from cext.bus.memory_bus cimport BusEnd

cdef enum:
    RING_FRAMES = 512               # a power of two
    FULL_SENDS_LIMIT = 10           # sends in a row to a full ring until the bus fails

cdef enum: # errors of a line other than an errno
    FULL = -1                       # the owner has not taken frames for a while

cdef struct FrameRing:
    uint64_t head                   # frames written, in total; owned by the writer
    uint64_t spare[7]               # keeps both ends on separate cache lines
    uint64_t tail                   # frames read, in total; owned by the reader
    uint64_t more[7]
    Frame frames[RING_FRAMES]

cdef struct LineCounts:             # frames; counted by the owner of the bus
    int64_t refused                 # rejected by the interface, and not sent
    int64_t echoes                  # own frames that the interface returned
    int64_t corrupt                 # no valid CAN frames
    int64_t errors                  # error frames of the interface
    int64_t overflows               # lost to a full ring
    int64_t withheld                # received by the owner after the fence was raised

cdef struct LineLayout:
    FrameRing outward               # from the loop to the owner
    FrameRing inward
    int32_t failed                  # an errno, once the bus has failed
    LineCounts counts

cdef struct LineEnd:                # end of the loop
    LineLayout *line
    int bell                        # eventfd that wakes the owner, or -1
    int64_t began                   # ns of CLOCK_MONOTONIC: zero of the frames' times
    int64_t refused                 # frames lost to a full ring
    int trouble
    int full                        # sends in a row to a full ring
    bint reported

cdef class Lines:
    cdef LineLayout *lines
    cdef object memory
    cdef readonly int fd
    cdef readonly int count
    cdef bint made_here
    cdef int at(self, int line) except -1

cdef class Line:
    cdef LineEnd context
    cdef Lines owner
    cdef readonly BusEnd end
