# cython: freethreading_compatible=True
"""Fatal signals of the process itself: SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT.

A process that writes a core dump takes time to end, while its motors would continue. The handler therefore first raises
the fence and reports the signal and the block to the guardian and the recorder in the shared state. Then the signal
takes its previous action, on a separate stack, since the thread's own stack may be exhausted.
"""

from libc.stdint cimport int32_t
from libc.string cimport memset

from cext.fused.locate cimport IN_RUN, CodeMap, item_of_context
from cext.safety.forks cimport is_child
from cext.memory.shared_state cimport FENCED_FOR_GOOD, SharedLayout, store_i32
from cext.posix cimport (
    SA_ONSTACK, SA_SIGINFO, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, action, pthread_self, pthread_t, raise_signal,
    sigaction, sigaltstack, siginfo_t, stack_t,
)

cdef enum:
    FATAL = 5
    STACK = 65536                           # bytes

cdef int[FATAL] SIGNALS = [SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT]
cdef action[FATAL] before                   # until `take_fatal`
cdef stack_t stack_before
cdef char[STACK] room
cdef SharedLayout *shared = NULL            # global, for the signal handler
cdef pthread_t loop = 0
cdef const CodeMap *code = NULL


cdef void on_fatal(int number, siginfo_t *information, void *context) noexcept nogil:
    cdef SharedLayout *layout = shared if not is_child() else NULL        # a child shares the memory of its parent
    cdef int index
    cdef int item
    if layout != NULL:
        store_i32(&layout.fence, FENCED_FOR_GOOD)         # as another process may have done: never back to 1
        item = layout.at if pthread_self() == loop else -1
        if item >= IN_RUN:
            index = item_of_context(code, context) if code != NULL else -1
            item = index if index >= 0 else item - IN_RUN
        store_i32(&layout.crashed, number)
        store_i32(&layout.hung, 1 + item if item >= 0 else -1)
    for index in range(FATAL):
        sigaction(SIGNALS[index], &before[index], NULL)
    raise_signal(number)                    # delivered on return, even if the instruction would not fail again


cdef void take_fatal(SharedLayout *layout, const CodeMap *map) noexcept nogil:
    """Raise the fence and report the signal on fatal signals from now on. The calling thread is the loop's.

    map : steps of the machine code, or NULL
    """
    global shared, loop, code
    cdef action install
    cdef stack_t own
    cdef int index
    shared, loop, code = layout, pthread_self(), map
    memset(&own, 0, sizeof(stack_t))
    own.ss_sp, own.ss_size = room, STACK
    sigaltstack(&own, &stack_before)
    memset(&install, 0, sizeof(action))
    install.sa_sigaction = on_fatal
    install.sa_flags = SA_ONSTACK | SA_SIGINFO
    for index in range(FATAL):
        sigaction(SIGNALS[index], &install, &before[index])


cdef void give_back_fatal() noexcept nogil:
    """Restore the state before `take_fatal`. A second call does nothing."""
    global shared, code
    cdef int index
    if shared == NULL:
        return
    for index in range(FATAL):
        sigaction(SIGNALS[index], &before[index], NULL)
    sigaltstack(&stack_before, NULL)
    shared, code = NULL, NULL
