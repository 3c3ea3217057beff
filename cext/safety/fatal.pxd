from cext.safety.shared_state cimport SharedLayout

cdef void take_fatal(SharedLayout *page, const int *at) noexcept nogil
cdef void give_back_fatal() noexcept nogil
