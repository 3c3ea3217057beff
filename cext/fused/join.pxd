from libc.stdint cimport int64_t

from cext.fused.locate cimport CodeMap

cdef class Code:
    cdef char *memory
    cdef size_t size, data_size
    cdef size_t at               # next byte of code
    cdef size_t used             # bytes of data
    cdef bint arm
    cdef dict places             # addresses of data
    cdef readonly list entries   # address of each run
    cdef CodeMap map

    cdef void note(self, int item) noexcept nogil
    cdef add(self, stencil, tuple slots, tuple sizes, tuple addresses, int step)
    cdef int64_t place(self, bytes data)
    cdef int64_t place_function(self, str name)
    cdef int64_t place_words(self, tuple words)
