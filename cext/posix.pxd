"""What cext needs of Linux: clocks, sleeping, signals, polling, memory that stays."""

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
