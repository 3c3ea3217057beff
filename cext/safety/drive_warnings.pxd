from libc.stdint cimport int64_t, uint32_t, uint64_t

from cext.memory.shared_state cimport SharedLayout

cdef enum:
    WARNING_BITS = 32

cdef class DriveWarnings:
    cdef int count
    cdef int *slots                  # of each drive's output `warning`
    cdef uint32_t *reported              # bits of each that have been reported in this run
    cdef void **texts                # EventTemplate, borrowed: WARNING_BITS of each drive
    cdef list news
    cdef uint64_t most
    cdef SharedLayout *layout

    cdef void reset(self) noexcept nogil
    cdef uint64_t share(self, SharedLayout *layout)
    cdef void look(self, double *arena, int64_t tick) noexcept nogil
