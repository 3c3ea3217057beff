# cython: freethreading_compatible=True
"""The signals that kill a process from within: SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT.

A process that leaves a core behind takes its time to die, and all that time its motors would turn. So the first that happens is that the
fence goes up, and that the page tells the guardian what has happened, and in which block. Then the signal does what it would have done
before, on a stack of its own, since there may be none left.
"""

from libc.stdint cimport int32_t
from libc.string cimport memset

from cext.safety.forks cimport is_child
from cext.safety.shared_state cimport PageLayout, store_i32
from cext.posix cimport (
    SA_ONSTACK, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, action, pthread_self, pthread_t, raise_signal, sigaction, sigaltstack, stack_t,
)

cdef enum:
    FATAL = 5
    STACK = 65536                           # bytes

cdef int[FATAL] SIGNALS = [SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT]
cdef action[FATAL] before                   # what they did until `take_fatal`
cdef stack_t stack_before
cdef char[STACK] room
cdef PageLayout *told = NULL                # a handler has nowhere else to look
cdef const int *busy_with = NULL
cdef pthread_t loop = 0


cdef void on_fatal(int number) noexcept nogil:
    cdef PageLayout *page = told if not is_child() else NULL        # the page of a child is its parent's
    cdef int index
    if page != NULL:
        store_i32(&page.hung, 1 + busy_with[0] if pthread_self() == loop and busy_with[0] >= 0 else -1)
        store_i32(&page.crashed, number)
        store_i32(&page.fence, 1)
    for index in range(FATAL):
        sigaction(SIGNALS[index], &before[index], NULL)
    raise_signal(number)                    # comes as soon as this returns, also where nothing would fail again


cdef void take_fatal(PageLayout *page, const int *at) noexcept nogil:
    """From now on they raise the fence first. at : item of the stopwatch that the calling thread works on, below 0: something else"""
    global told, busy_with, loop
    cdef action install
    cdef stack_t own
    cdef int index
    told, busy_with, loop = page, at, pthread_self()
    memset(&own, 0, sizeof(stack_t))
    own.ss_sp, own.ss_size = room, STACK
    sigaltstack(&own, &stack_before)
    memset(&install, 0, sizeof(action))
    install.sa_handler = on_fatal
    install.sa_flags = SA_ONSTACK
    for index in range(FATAL):
        sigaction(SIGNALS[index], &install, &before[index])


cdef void give_back_fatal() noexcept nogil:
    """All is as before `take_fatal`. Again: nothing."""
    global told
    cdef int index
    if told == NULL:
        return
    for index in range(FATAL):
        sigaction(SIGNALS[index], &before[index], NULL)
    sigaltstack(&stack_before, NULL)
    told = NULL
