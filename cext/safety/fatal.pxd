from cext.safety.shared_state cimport PageLayout

cdef void take_fatal(PageLayout *page, const int *at) noexcept nogil
cdef void give_back_fatal() noexcept nogil
