"""Buses that another process owns: for each, a ring of frames out to it and one back.

One process writes each ring, one reads it, nothing locks.
"""

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.abi cimport Frame
from cext.bus.memory_bus cimport BusEnd

cdef enum:
    ROOM = 512                      # frames of a ring, a power of two
    PATIENCE = 10                   # sends in a row that find the ring full, then the bus has failed

cdef enum: # troubles of a line that are no errno
    FULL = -1                       # nobody has taken our frames for a while

cdef struct FrameRing:
    uint64_t head                   # frames ever written; the writer's
    uint64_t spare[7]               # keeps the two ends on cache lines of their own
    uint64_t tail                   # frames ever read; the reader's
    uint64_t more[7]
    Frame frames[ROOM]

cdef struct LineCounts:             # frames; the bus's owner counts
    int64_t refused                 # that the interface had no room for, and were not sent
    int64_t echoes                  # of our own that the interface handed back
    int64_t corrupt                 # that are no CAN frames
    int64_t errors                  # in which the interface tells of itself
    int64_t overflows               # that found the ring full
    int64_t withheld                # that came to the owner after the fence was up

cdef struct LineLayout:
    FrameRing outward               # from the loop to the bus
    FrameRing inward
    int32_t failed                  # an errno, once the bus can neither send nor receive
    LineCounts counts

cdef struct LineEnd:                # the loop's
    LineLayout *line
    int bell                        # eventfd that wakes the owner, or -1
    int64_t began                   # ns, CLOCK_MONOTONIC: the zero of the frames' times
    int64_t refused                 # frames that found the ring full
    int trouble
    int full                        # times in a row
    bint told

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
