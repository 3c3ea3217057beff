from libc.stdint cimport int32_t, uintptr_t

from cext.posix cimport pthread_t

cdef enum:
    IN_RUN = 0x40000000         # added to the item of the first step of a run of machine code: any of its steps executes

cdef struct CodeMap:            # addresses of machine code and the steps that it is of
    uintptr_t begin, end
    int count
    uintptr_t *starts           # start of each step, increasing
    int32_t *items              # item of the stopwatch of each step

cdef int item_at(const CodeMap *map, uintptr_t address) noexcept nogil
cdef int item_of_context(const CodeMap *map, const void *context) noexcept nogil
cdef int begin_samples(const CodeMap *map) noexcept nogil
cdef void end_samples() noexcept nogil
cdef int sample(pthread_t thread) noexcept nogil
