from libc.stdint cimport int64_t

from cext.abi cimport Frame
from cext.bus.memory_bus cimport BusEnd

cdef struct Reel:                # what one bus received, drain by drain
    Frame *frames
    int64_t *ends                # index of the frame behind the last one of each drain
    int64_t count                # drains
    int64_t next
    int64_t place                # of the next frame of the drain that is open,
    int64_t stop                 # and where it ends

cdef class TapeBus:
    cdef Reel reel
    cdef readonly BusEnd host

cdef class Tape:
    cdef const int64_t *ticks
    cdef const int64_t *late     # ns
    cdef int64_t count, next
    cdef object keep
    cdef readonly bint simulated
    cdef const int64_t *drained      # ns, of each time that the buses were drained before tick 0
    cdef int64_t drains

    cdef bint advance(self, int64_t *tick, int64_t *late) noexcept nogil
