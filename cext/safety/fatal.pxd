from libc.stdint cimport int32_t

from cext.fused.locate cimport CodeMap
from cext.memory.shared_state cimport SharedLayout

cdef void end_hung() noexcept nogil
cdef int take_fatal(SharedLayout *layout, const CodeMap *map, const int32_t *at, bytes items, bytes python) except -1
cdef void give_back_fatal() noexcept nogil
