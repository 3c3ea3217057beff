from cext.fused.locate cimport CodeMap
from cext.memory.shared_state cimport SharedLayout

cdef void take_fatal(SharedLayout *layout, const CodeMap *map) noexcept nogil
cdef void give_back_fatal() noexcept nogil
