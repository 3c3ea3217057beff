from libc.stdint cimport int32_t, int64_t

from cext.posix cimport CLOCK_MONOTONIC, clock_gettime, timespec

cdef inline int64_t clock(int which) noexcept nogil:
    cdef timespec now
    clock_gettime(which, &now)
    return <int64_t>now.tv_sec * 1000000000 + now.tv_nsec

cdef inline int64_t monotonic() noexcept nogil:
    return clock(CLOCK_MONOTONIC)

cdef class Pace:
    cdef double rate                 # Hz
    cdef int64_t period              # ns, rounded
    cdef const int32_t *caught

    cdef int64_t grid(self, int64_t tick) noexcept nogil
    cdef int64_t newest(self, int64_t ns) noexcept nogil
    cdef void sleep_until(self, int64_t deadline) noexcept nogil
