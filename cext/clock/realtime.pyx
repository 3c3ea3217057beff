# cython: freethreading_compatible=True
"""Linux system calls of a real-time loop that Python lacks.

Locked memory, a prefaulted stack, timer slack, slices, and a real-time priority that ends if the thread spins.
runtime.host.machine.realtime decides on their use.
"""

import errno
import os

from cext.posix cimport (
    MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT, PR_GET_TIMERSLACK, PR_SET_TIMERSLACK, SA_RESTART, SIGXCPU,
    action, madvise, mlock, mlockall, munlockall, prctl, sigaction,
)
from libc.stdint cimport uintptr_t
from libc.string cimport memset

cdef extern from *:
    """
    #include <errno.h>
    #include <sched.h>
    #include <sys/mman.h>
    #include <sys/syscall.h>
    #include <unistd.h>

    #ifndef SCHED_RESET_ON_FORK
    #define SCHED_RESET_ON_FORK 0x40000000
    #endif

    // The first version of Linux's struct sched_attr, which every later kernel accepts; libc lacks the call.
    struct tw_attributes {
        unsigned int size, policy;
        unsigned long long flags;
        int nice;
        unsigned int priority;
        unsigned long long runtime, deadline, period;
    };

    // Returns 0 or errno. Changes the slice only.
    static int tw_set_slice(unsigned long long slice)
    {
        struct tw_attributes found = {0};
        if (syscall(SYS_sched_getattr, 0, &found, sizeof found, 0) != 0)
            return errno;
        found.runtime = slice;
        return syscall(SYS_sched_setattr, 0, &found, 0) != 0 ? errno : 0;
    }

    static unsigned long long tw_slice(void)
    {
        struct tw_attributes found = {0};
        return syscall(SYS_sched_getattr, 0, &found, sizeof found, 0) == 0 ? found.runtime : 0;
    }

    static volatile int tw_watched = 0;     // thread that loses its priority, 0: none
    static volatile int tw_spun = 0;

    static void tw_watch_this_thread(void) { tw_watched = (int)syscall(SYS_gettid); tw_spun = 0; }

    // RLIMIT_RTTIME has run out: a real-time thread has not slept for that long. It continues as an ordinary thread.
    static void tw_on_spinning(int number)
    {
        int before = errno;
        struct sched_param ordinary = {0};
        (void)number;
        if (tw_watched && sched_setscheduler(tw_watched, SCHED_OTHER | SCHED_RESET_ON_FORK, &ordinary) == 0)
            tw_spun = 1;
        errno = before;
    }

    #ifndef MADV_POPULATE_READ
    #define MADV_POPULATE_READ 22
    #define MADV_POPULATE_WRITE 23
    #endif

    // Touch every page of the next `size` bytes below, to avoid page faults during a tick.
    static void __attribute__((noinline)) tw_touch_stack(long size)
    {
        volatile char block[4096];
        block[0] = 0;
        block[sizeof block - 1] = 0;
        if (size > (long)sizeof block)
            tw_touch_stack(size - (long)sizeof block);
        block[1] = 0;                       // not a tail call
    }
    """
    const int MADV_POPULATE_READ
    const int MADV_POPULATE_WRITE
    int spun "tw_spun"                      # global, for the signal handler
    int watched "tw_watched"
    void watch_this_thread "tw_watch_this_thread"() noexcept nogil
    void on_spinning "tw_on_spinning"(int number) noexcept nogil
    void touch_stack "tw_touch_stack"(long size) noexcept nogil
    unsigned long long current_slice "tw_slice"() noexcept nogil
    int request_slice "tw_set_slice"(unsigned long long slice) noexcept nogil

cdef action before                          # handler of SIGXCPU until `watch_for_spinning`


cdef object failed(int number):
    return OSError(number, os.strerror(number))


cdef extern from "<errno.h>" nogil:
    int error_number "errno"


def lock_memory() -> None:
    """Lock the present and future memory of this process against paging, each page when it is first used.

    Raises OSError.
    """
    if mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0:
        raise failed(error_number)


def prefault(uintptr_t begin, uintptr_t end, bint writable) -> None:
    """Bring the pages of a mapping of this process into memory. Their content stays.

    Memory that has been released since its addresses were read is skipped.

    begin, end : addresses, multiples of the page size
    writable : whether the mapping can be written; its pages are then private copies
    """
    if madvise(<void *>begin, end - begin, MADV_POPULATE_WRITE if writable else MADV_POPULATE_READ) != 0:
        mlock(<void *>begin, end - begin)       # Linux before 5.14


def unlock_memory() -> None:
    """Undo `lock_memory`."""
    if munlockall() != 0:
        raise failed(error_number)


def prefault_stack(long size) -> None:
    """Touch `size` bytes of this thread's stack below its present end."""
    touch_stack(size)


def timer_slack() -> int:
    """Return the ns by which the kernel may delay the end of this thread's sleeps to save wake-ups."""
    return prctl(PR_GET_TIMERSLACK, 0)


def set_timer_slack(unsigned long nanoseconds) -> None:
    """Set the timer slack in ns; 0 for the thread's default. A real-time thread has none."""
    prctl(PR_SET_TIMERSLACK, nanoseconds)


def slice_length() -> int:
    """Return the time slice of this thread in ns; 0 if unknown (Linux before 6.12)."""
    return current_slice()


def set_slice(unsigned long long nanoseconds) -> None:
    """Request a time slice for this ordinary thread in ns; 0 for the default of a few ms. Raises OSError.

    A thread with a short slice preempts threads with a longer one when it wakes. It needs no privilege. Linux before
    6.12 accepts the request without an effect.
    """
    cdef int number = request_slice(nanoseconds)
    if number != 0:
        raise failed(number)


def watch_for_spinning() -> None:
    """Make SIGXCPU turn the calling thread into an ordinary one.

    The caller sets RLIMIT_RTTIME, which sends the signal.
    """
    cdef action install
    if watched:
        raise OSError(errno.EBUSY, "a thread is already being watched")
    memset(&install, 0, sizeof(action))
    install.sa_handler = on_spinning
    install.sa_flags = SA_RESTART
    watch_this_thread()
    sigaction(SIGXCPU, &install, &before)


def stop_watching() -> bool:
    """Restore the previous action of SIGXCPU. Returns whether the thread has lost its priority."""
    global watched
    if watched:
        sigaction(SIGXCPU, &before, NULL)
        watched = 0
    return spun != 0
