from libc.stdint cimport int64_t

from cext.abi cimport Frame
from cext.bus.batch cimport Batch
from cext.safety.reply_field cimport PATTERN_LIMIT, Field, Pattern

cdef class SpeedBands:
    cdef Batch *batches
    cdef double *speeds          # rad/s, upper end of each band; the last is infinite
    cdef readonly int count
    cdef Pattern patterns[PATTERN_LIMIT]
    cdef int pattern_count       # 0: no reply contains the velocity
    cdef Field velocity          # rad/s
    cdef double acceleration     # rad/s²
    cdef readonly int64_t round  # ns
    cdef readonly int64_t transit    # ns, assumed
    cdef double speed            # rad/s, newest
    cdef int64_t seen            # ns of its arrival; -1 before the first

    cdef int load(self, velocity) except -1
    cdef void forget(self) noexcept nogil
    cdef bint note(self, const Frame *frame) noexcept nogil
    cdef const Batch *choose(self, int64_t now, int64_t transit) noexcept nogil
