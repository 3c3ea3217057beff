from cext.safety.shared_state cimport SharedLayout

cdef void take_fatal(SharedLayout *page) noexcept nogil
cdef void give_back_fatal() noexcept nogil
