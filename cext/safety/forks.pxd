from libc.stdint cimport int32_t

cdef void begin_run() noexcept nogil
cdef bint is_child() noexcept nogil
cdef void leave() noexcept nogil
