from libc.stdint cimport int32_t, int64_t

from cext.posix cimport pthread_t
from cext.lines.reopening cimport Reopening
from cext.lines.stream cimport Source

cdef class Streams(Reopening):
    cdef list streams
    cdef Source **sources
    cdef int count
    cdef pthread_t thread
    cdef bint running
    cdef int32_t leave
    cdef int priority
    cdef void serve(self) noexcept nogil
    cdef int look_after(self, int64_t now) noexcept nogil
    cdef bint take(self, Source *source) noexcept nogil
