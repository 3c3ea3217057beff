from libc.stdint cimport int64_t, uint8_t, uint32_t

from cext.lines.stream cimport Source

cdef extern from "<sys/epoll.h>" nogil:
    ctypedef union epoll_data_t:
        uint32_t u32
    cdef struct epoll_event:
        uint32_t events
        epoll_data_t data
    int epoll_create1(int flags)
    int epoll_ctl(int epoll, int operation, int fd, epoll_event *event)
    int epoll_wait(int epoll, epoll_event *events, int most, int timeout)
    const int EPOLL_CLOEXEC, EPOLL_CTL_ADD, EPOLL_CTL_DEL
    const uint32_t EPOLLIN, EPOLLOUT, EPOLLHUP, EPOLLERR

cdef enum:
    READ_SIZE = 1 << 16                 # bytes of one read: the longest datagram

cdef class Reopening:
    cdef int epoll, nothing
    cdef uint8_t *buffer                # buffer of the thread, READ_SIZE bytes
    cdef int listen(self, int fd, uint32_t events, int index) noexcept nogil
    cdef void lose(self, Source *source, int error, int64_t now) noexcept nogil
    cdef void try_again(self, Source *source, int index, int64_t now) noexcept nogil
    cdef void request_identity(self, Source *source, int found, int index, int64_t now) noexcept nogil
    cdef bint has_identified(self, Source *source) noexcept nogil
    cdef void settle(self, Source *source, int index, int64_t now) noexcept nogil
    cdef void give_up(self, Source *source, int64_t now) noexcept nogil
    cdef bint resume(self, Source *source, int found, int index, int64_t now) noexcept nogil

cdef void send_setup(Source *source) noexcept nogil
