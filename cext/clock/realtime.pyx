# cython: freethreading_compatible=True
"""What a loop needs of Linux so that it does not wait, where Python has no call for it.

Memory that stays, a stack that is there, sleeps that end on time, and a real-time priority that ends when its thread
spins. Whether and when is decided in runtime.machine.realtime.
"""

import errno
import os

from cext.posix cimport (
    MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT, PR_GET_TIMERSLACK, PR_SET_TIMERSLACK, SA_RESTART, SIGXCPU,
    action, mlockall, munlockall, prctl, sigaction,
)
from libc.string cimport memset

cdef extern from *:
    """
    #include <errno.h>
    #include <sched.h>
    #include <sys/syscall.h>
    #include <unistd.h>

    #ifndef SCHED_RESET_ON_FORK
    #define SCHED_RESET_ON_FORK 0x40000000
    #endif

    // Linux's struct sched_attr as it was at first, which every kernel since takes; libc has no call for it.
    struct tw_attributes {
        unsigned int size, policy;
        unsigned long long flags;
        int nice;
        unsigned int priority;
        unsigned long long runtime, deadline, period;
    };

    // 0 or errno. Nothing but the slice is changed.
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

    static volatile int tw_watched = 0;     // the thread whose priority ends, 0: none
    static volatile int tw_spun = 0;

    static void tw_watch_this_thread(void) { tw_watched = (int)syscall(SYS_gettid); tw_spun = 0; }

    // RLIMIT_RTTIME has run out: a thread of real-time priority has not slept for so long. It goes on, as an ordinary one.
    static void tw_on_spinning(int number)
    {
        int before = errno;
        struct sched_param ordinary = {0};
        (void)number;
        if (tw_watched && sched_setscheduler(tw_watched, SCHED_OTHER | SCHED_RESET_ON_FORK, &ordinary) == 0)
            tw_spun = 1;
        errno = before;
    }

    // Every page of the next `size` bytes below, so that none of them is missing in the middle of a tick.
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
    int spun "tw_spun"                      # a handler has nowhere else to put it
    int watched "tw_watched"
    void watch_this_thread "tw_watch_this_thread"() noexcept nogil
    void on_spinning "tw_on_spinning"(int number) noexcept nogil
    void touch_stack "tw_touch_stack"(long size) noexcept nogil
    unsigned long long current_slice "tw_slice"() noexcept nogil
    int request_slice "tw_set_slice"(unsigned long long slice) noexcept nogil

cdef action before                          # what SIGXCPU did until `watch_for_spinning`


cdef object failed(int number):
    return OSError(number, os.strerror(number))


cdef extern from "<errno.h>" nogil:
    int error_number "errno"


def lock_memory(bint as_touched=False):
    """Keep all memory of this process, present and future, from being paged out. OSError.

    as_touched : do not bring in now what nobody has touched yet
    """
    if mlockall(MCL_CURRENT | MCL_FUTURE | (MCL_ONFAULT if as_touched else 0)) != 0:
        raise failed(error_number)


def unlock_memory():
    if munlockall() != 0:
        raise failed(error_number)


def prefault_stack(long size):
    """Bring in `size` bytes of this thread's stack, below where it stands."""
    touch_stack(size)


def timer_slack():
    """ns by which the kernel may let this thread's sleeps last longer, to save wake-ups."""
    return prctl(PR_GET_TIMERSLACK, 0)


def set_timer_slack(unsigned long nanoseconds):
    """ns; 0 for the thread's default. A thread of real-time priority has none."""
    prctl(PR_SET_TIMERSLACK, nanoseconds)


def slice_length():
    """ns that this thread may run at a stretch; 0 where the system does not say (Linux before 6.12)."""
    return current_slice()


def set_slice(unsigned long long nanoseconds):
    """For how long this ordinary thread wants to run at a stretch; 0 for the default, a few ms. OSError.

    Who asks for little gets it soon: a thread that wakes takes the processor from one that asked for more. It needs no privilege. Linux before
    6.12 takes the wish and does nothing.
    """
    cdef int number = request_slice(nanoseconds)
    if number != 0:
        raise failed(number)


def watch_for_spinning():
    """From now on SIGXCPU makes the calling thread an ordinary one. What sends it is RLIMIT_RTTIME, which the caller sets."""
    cdef action install
    if watched:
        raise OSError(errno.EBUSY, "a thread is watched already")
    memset(&install, 0, sizeof(action))
    install.sa_handler = on_spinning
    install.sa_flags = SA_RESTART
    watch_this_thread()
    sigaction(SIGXCPU, &install, &before)


def stop_watching():
    """SIGXCPU does what it did before. Returns whether the thread has lost its priority."""
    global watched
    if watched:
        sigaction(SIGXCPU, &before, NULL)
        watched = 0
    return spun != 0
