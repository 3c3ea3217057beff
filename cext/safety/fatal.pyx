# cython: freethreading_compatible=True
"""Ends of the process in the middle of a run: SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, exit().

A process that writes a core dump takes time to end, while its motors would continue. The handler therefore first raises
the fence and reports the signal and the block to the guardian and the recorder in the shared state. Then the signal
takes its previous action, on a separate stack, since the thread's own stack may be exhausted. A library that calls
exit() ends the process as a fault, whatever status it passes.
"""

from libc.stdint cimport int32_t
from libc.stdlib cimport atexit
from libc.string cimport memset, strchr, strlen
from posix.unistd cimport _exit, write

from cext.fused.locate cimport IN_RUN, CodeMap, item_of_context
from cext.safety.forks cimport is_child
from cext.memory.shared_state cimport FENCED_FOR_GOOD, SharedLayout, store_i32
from cext.posix cimport (
    SA_ONSTACK, SA_SIGINFO, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, action, pthread_self, pthread_t, raise_signal,
    sigaction, sigaltstack, siginfo_t, stack_t,
)

cdef extern from "Python.h" nogil:
    void PyErr_SetInterrupt()

cdef enum:
    FATAL = 5
    STACK = 65536                           # bytes
    EXIT_CODE = 3                           # of a run that ends in a fault

cdef int[FATAL] SIGNALS = [SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT]
cdef action[FATAL] before                   # until `take_fatal`
cdef stack_t stack_before
cdef char[STACK] room
cdef SharedLayout *shared = NULL            # global, for the signal handler
cdef pthread_t loop = 0
cdef const CodeMap *code = NULL
cdef const int32_t *at = NULL               # present item of the stopwatch; NULL outside a run
cdef bytes lines = b""                      # names of the items
cdef const char *names = NULL               # the text of `lines`
cdef bytes kinds = b""                      # whether each item is a step in Python
cdef const char *steps = NULL               # the bytes of `kinds`


cdef void leave(const char *what, const char *where) noexcept nogil:
    """End the process as a fault, and print the block of the present step."""
    cdef const char *name = names
    cdef int item = at[0] & ~IN_RUN if at[0] >= 0 and pthread_self() == loop else -1
    if shared != NULL:
        store_i32(&shared.fence, FENCED_FOR_GOOD)
        store_i32(&shared.hung, 1 + item if item >= 0 else -1)
    write(2, what, strlen(what))
    if item >= 0:
        while item > 0:
            name = strchr(name, 10) + 1     # of the next line
            item -= 1
        write(2, where, strlen(where))
        write(2, name, strchr(name, 10) - name)
    write(2, b"\n", 1)
    _exit(EXIT_CODE)


cdef void on_exit() noexcept nogil:
    if at != NULL and not is_child():
        leave(b"tickwork: a library called exit()", b" in ")


cdef void end_hung() noexcept nogil:
    """End a step of the loop that executes: for a signal after one that the loop has not responded to.

    Python code gets a KeyboardInterrupt; a library cannot be interrupted, and ends the process.
    """
    if at == NULL or at[0] < 0 or is_child():
        return
    if steps[at[0] & ~IN_RUN]:
        PyErr_SetInterrupt()
    else:
        leave(b"tickwork: the process was ended by a second signal: the run hangs", b" in ")


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


cdef int take_fatal(SharedLayout *layout, const CodeMap *map, const int32_t *present, bytes items, bytes python) except -1:
    """Raise the fence and report the end on fatal signals and exit() from now on. The calling thread is the loop's.

    layout : NULL without shared state, and so without reports of signals
    map : steps of the machine code, or NULL
    present : item of the stopwatch that the loop executes, below 0: none
    items : names of the items, each with a line feed
    python : whether each is a step in Python, as a byte
    """
    global shared, loop, code, at, lines, names, kinds, steps
    cdef action install
    cdef stack_t own
    cdef int index
    lines, names, kinds, steps = items, items, python, python
    shared, loop, code, at = layout, pthread_self(), map, present
    if layout == NULL:
        return 0
    memset(&own, 0, sizeof(stack_t))
    own.ss_sp, own.ss_size = room, STACK
    sigaltstack(&own, &stack_before)
    memset(&install, 0, sizeof(action))
    install.sa_sigaction = on_fatal
    install.sa_flags = SA_ONSTACK | SA_SIGINFO
    for index in range(FATAL):
        sigaction(SIGNALS[index], &install, &before[index])
    return 0


cdef void give_back_fatal() noexcept nogil:
    """Restore the state before `take_fatal`. A second call does nothing."""
    global shared, code, at
    cdef int index
    at = NULL
    if shared == NULL:
        return
    for index in range(FATAL):
        sigaction(SIGNALS[index], &before[index], NULL)
    sigaltstack(&stack_before, NULL)
    shared, code = NULL, NULL


atexit(on_exit)
