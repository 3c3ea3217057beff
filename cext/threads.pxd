"""Native threads beside the loop: start, name, priority, sleep. None of them takes the GIL."""

from libc.stdint cimport int32_t, int64_t

from cext.posix cimport (
    PR_SET_NAME, SCHED_FIFO, SCHED_RESET_ON_FORK, SIG_SETMASK, prctl, pthread_attr_destroy, pthread_attr_init,
    pthread_attr_setstacksize,
    pthread_attr_t, pthread_create, pthread_sigmask, pthread_t, sched_param, sched_setscheduler, sigfillset, sigset_t,
)

cdef extern from *:
    """
    #include <linux/futex.h>
    #include <stdint.h>
    #include <sys/syscall.h>
    #include <time.h>
    #include <unistd.h>

    static inline void tw_doze(int32_t *word, int64_t until) {
        struct timespec at = {until / 1000000000, until % 1000000000};
        syscall(SYS_futex, word, FUTEX_WAIT_BITSET_PRIVATE, 0, &at, NULL, FUTEX_BITSET_MATCH_ANY);
    }
    static inline void tw_wake(int32_t *word) {
        syscall(SYS_futex, word, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
    }
    """
    # Sleep until an instant of CLOCK_MONOTONIC in ns, or until the word is woken, while it is 0.
    void doze "tw_doze"(int32_t *word, int64_t until) noexcept nogil
    void wake "tw_wake"(int32_t *word) noexcept nogil


cdef inline int start_thread(
        pthread_t *thread, void *(*enter)(void *) noexcept nogil, void *context, size_t stack) noexcept nogil:
    """Start a thread. Returns 0 or errno. stack : bytes, which count as locked memory if memory is locked"""
    cdef pthread_attr_t attributes
    cdef sigset_t everything, mine
    cdef int failed
    pthread_attr_init(&attributes)
    pthread_attr_setstacksize(&attributes, stack)
    sigfillset(&everything)
    # signals belong to the loop: the new thread inherits the mask
    pthread_sigmask(SIG_SETMASK, &everything, &mine)
    failed = pthread_create(thread, &attributes, enter, context)
    pthread_sigmask(SIG_SETMASK, &mine, NULL)
    pthread_attr_destroy(&attributes)
    return failed


cdef inline bint be_called(const char *name, int priority) noexcept nogil:
    """Name the calling thread. priority : of SCHED_FIFO, 0 for an ordinary one. Returns False if it is not granted."""
    cdef sched_param parameters
    prctl(PR_SET_NAME, <unsigned long>name)
    if priority <= 0:
        return True
    parameters.sched_priority = priority
    return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0
