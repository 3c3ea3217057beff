"""Declarations of Linux and POSIX: clocks, sleeping, signals, polling, locked memory, multiple datagrams, threads."""

cdef extern from "<time.h>" nogil:
    cdef struct timespec:
        long tv_sec
        long tv_nsec
    int clock_gettime(int clock, timespec *time)
    int clock_nanosleep(int clock, int flags, const timespec *request, timespec *remain)
    const int CLOCK_BOOTTIME
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
    ctypedef struct siginfo_t:
        pass
    ctypedef void (*context_handler_t)(int, siginfo_t *information, void *context)
    cdef struct action "sigaction":
        handler_t sa_handler
        context_handler_t sa_sigaction                  # with SA_SIGINFO
        int sa_flags
        sigset_t sa_mask
    int sigaction(int signum, const action *new, action *old)
    const int SIGINT
    const int SIGTERM
    const int SIGHUP
    const int SIGQUIT
    const int SIGUSR1
    const int SIGURG
    const int SIGXCPU
    const int SIGSEGV
    const int SIGBUS
    const int SIGFPE
    const int SIGILL
    const int SIGABRT
    const int SA_RESTART
    const int SA_SIGINFO
    const int SIGRTMIN
    const int SA_ONSTACK
    ctypedef struct stack_t:
        void *ss_sp
        int ss_flags
        size_t ss_size
    int sigaltstack(const stack_t *stack, stack_t *before)
    int raise_signal "raise"(int signum)
    int sigemptyset(sigset_t *set)
    int sigfillset(sigset_t *set)
    int sigaddset(sigset_t *set, int signum)
    int pthread_sigmask(int how, const sigset_t *set, sigset_t *before)
    const int SIG_SETMASK
    const int SIG_UNBLOCK

cdef extern from "<pthread.h>" nogil:
    ctypedef unsigned long pthread_t
    ctypedef struct pthread_attr_t:
        pass
    int pthread_attr_init(pthread_attr_t *attributes)
    int pthread_attr_setstacksize(pthread_attr_t *attributes, size_t size)
    int pthread_attr_destroy(pthread_attr_t *attributes)
    int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*start)(void *) noexcept nogil,
        void *argument)
    int pthread_join(pthread_t thread, void **result)
    int pthread_kill(pthread_t thread, int signum)
    pthread_t pthread_self()
    int pthread_atfork(void (*prepare)() noexcept nogil, void (*parent)() noexcept nogil,
        void (*child)() noexcept nogil)

cdef extern from "<sched.h>" nogil:
    cdef struct sched_param:
        int sched_priority
    int sched_getscheduler(int pid)
    int sched_getparam(int pid, sched_param *parameters)
    int sched_setscheduler(int pid, int policy, const sched_param *parameters)
    const int SCHED_FIFO
    const int SCHED_RESET_ON_FORK
    ctypedef struct cpu_set_t:
        pass
    void CPU_ZERO(cpu_set_t *processors)
    void CPU_SET(int number, cpu_set_t *processors)
    int CPU_COUNT(cpu_set_t *processors)
    int sched_getaffinity(int pid, size_t size, cpu_set_t *processors)
    int sched_setaffinity(int pid, size_t size, const cpu_set_t *processors)

cdef extern from "<sys/prctl.h>" nogil:
    int prctl(int option, unsigned long argument)
    const int PR_SET_TIMERSLACK
    const int PR_GET_TIMERSLACK
    const int PR_SET_NAME

cdef extern from "<sys/mman.h>" nogil:
    int mlock(const void *address, size_t length)
    int mlockall(int flags)
    int munlockall()
    const int MCL_CURRENT
    const int MCL_FUTURE
    const int MCL_ONFAULT
    int madvise(void *address, size_t length, int advice)
