from libc.stdint cimport int64_t

from cext.memory.shared_state cimport SharedLayout

cdef class EventTemplate:
    cdef bytes text                      # JSON up to the number of the tick
    cdef const char *begin
    cdef size_t length

    cdef size_t size(self) noexcept nogil
    cdef void publish(self, SharedLayout *layout, int64_t tick) noexcept nogil
