from libc.stdint cimport int64_t

from cext.journal cimport Journal
from cext.pace cimport Pace
from cext.program cimport Program

cdef class Tick:
    cdef Program control, plant
    cdef Journal journal
    cdef Pace pace
    cdef int substeps
    cdef int64_t plant_tick

    cdef void reset(self)
    cdef void set_clock(self, int64_t tick, int64_t previous, int64_t late) noexcept nogil
    cdef int run(self, int64_t tick, int64_t previous, int64_t now) noexcept nogil
    cdef int advance_plant(self, int64_t now) noexcept nogil
