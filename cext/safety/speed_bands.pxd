from libc.stdint cimport int64_t, uint8_t, uint32_t

from cext.abi cimport Frame
from cext.bus.batch cimport Batch

cdef enum:
    PATTERN_LIMIT = 4
    PREFIX_BYTES = 4

cdef struct Pattern:             # of a frame with the velocity
    uint32_t id                  # with the flag bits of struct can_frame
    uint32_t mask
    uint8_t prefix[PREFIX_BYTES]
    int length                   # bytes of the prefix

cdef class SpeedBands:
    cdef Batch *batches
    cdef double *speeds          # rad/s, upper end of each band; the last is infinite
    cdef readonly int count
    cdef Pattern patterns[PATTERN_LIMIT]
    cdef int pattern_count       # 0: no reply contains the velocity
    cdef int first, bits         # of the velocity's code, counted from the first bit of the data
    cdef bint signed
    cdef double low, step        # rad/s, value of code 0 and of one code
    cdef double acceleration     # rad/s²
    cdef readonly int64_t round  # ns
    cdef double speed            # rad/s, newest
    cdef int64_t seen            # ns of its arrival; -1 before the first

    cdef int load(self, velocity) except -1
    cdef void forget(self) noexcept nogil
    cdef bint note(self, const Frame *frame) noexcept nogil
    cdef const Batch *choose(self, int64_t now) noexcept nogil
