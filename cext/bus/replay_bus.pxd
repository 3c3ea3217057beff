from libc.stdint cimport int64_t

from cext.abi cimport Frame
from cext.bus.memory_bus cimport BusEnd

cdef struct ReplayBuffer:        # frames that one bus received, by drains
    const Frame *frames
    const int64_t *ends          # index after the last frame of each drain
    int64_t count                # drains
    int64_t first                # number of the first of them; the first of the recording is 1
    int64_t drain                # number of the current drain
    int64_t place                # next frame of the current drain
    int64_t stop                 # its end

cdef class ReplayBus:
    cdef ReplayBuffer buffer
    cdef object keep
    cdef readonly BusEnd host

cdef class ReplayClock:
    cdef const int64_t *ticks
    cdef const int64_t *late     # ns
    cdef int64_t count, next
    cdef object keep, before, refill
    cdef readonly object error
    cdef readonly bint simulated
    cdef const int64_t *drained      # ns, of each time that the buses were drained before tick 0
    cdef int64_t drains
    cdef readonly int64_t confirmed  # number of drains before the operator confirmed, -1 without

    cdef bint advance(self, int64_t *tick, int64_t *late) noexcept nogil
    cdef bint refilled(self) noexcept nogil
