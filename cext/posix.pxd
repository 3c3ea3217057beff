"""What cext needs of Linux: clocks, sleeping, signals, polling, memory that stays, datagrams by the dozen."""

cdef extern from "<time.h>" nogil:
    cdef struct timespec:
        long tv_sec
        long tv_nsec
    int clock_gettime(int clock, timespec *time)
    int clock_nanosleep(int clock, int flags, const timespec *request, timespec *remain)
    const int CLOCK_MONOTONIC
    const int CLOCK_REALTIME
    const int CLOCK_THREAD_CPUTIME_ID
    const int TIMER_ABSTIME

cdef extern from "<poll.h>" nogil:
    cdef struct pollfd:
        int fd
        short events
        short revents
    int poll(pollfd *files, unsigned long count, int timeout)
    const short POLLIN

cdef extern from "<sys/uio.h>" nogil:
    cdef struct iovec:
        void *iov_base
        size_t iov_len

cdef extern from "<sys/socket.h>" nogil:
    cdef struct msghdr:
        iovec *msg_iov
        size_t msg_iovlen
        void *msg_control
        size_t msg_controllen
        int msg_flags
    cdef struct mmsghdr:
        msghdr msg_hdr
        unsigned msg_len
    cdef struct cmsghdr:
        int cmsg_level
        int cmsg_type
    cmsghdr *CMSG_FIRSTHDR(msghdr *message)
    unsigned char *CMSG_DATA(cmsghdr *part)
    int recvmmsg(int fd, mmsghdr *messages, unsigned count, int flags, timespec *timeout)
    int sendmmsg(int fd, mmsghdr *messages, unsigned count, int flags)
    const int MSG_CONFIRM
    const int MSG_DONTROUTE
    const int MSG_DONTWAIT
    const int MSG_NOSIGNAL
    const int MSG_TRUNC
    const int SOL_SOCKET
    const int SCM_TIMESTAMPNS

cdef extern from "<signal.h>" nogil:
    ctypedef struct sigset_t:
        pass
    ctypedef void (*handler_t)(int)
    cdef struct action "sigaction":
        handler_t sa_handler
        int sa_flags
        sigset_t sa_mask
    int sigaction(int signum, const action *new, action *old)
    const int SIGINT
    const int SIGTERM
    const int SIGHUP
    const int SIGXCPU
    const int SA_RESTART

cdef extern from "<sys/prctl.h>" nogil:
    int prctl(int option, unsigned long argument)
    const int PR_SET_TIMERSLACK
    const int PR_GET_TIMERSLACK

cdef extern from "<sys/mman.h>" nogil:
    int mlockall(int flags)
    int munlockall()
    const int MCL_CURRENT
    const int MCL_FUTURE
    const int MCL_ONFAULT
