# cython: freethreading_compatible=True
"""The step that machine code executes, from the registers of a signal's context: a program stores no step by step."""

from libc.stdint cimport int32_t, int64_t, uintptr_t
from libc.string cimport memset

from cext.atomics cimport load_i32, store_i32
from cext.clock.deadline_clock cimport monotonic
from cext.posix cimport SA_RESTART, SA_SIGINFO, SIGRTMIN, action, pthread_kill, pthread_t, sigaction, siginfo_t
from cext.threads cimport doze, wake

cdef extern from *:
    """
    #define _GNU_SOURCE
    #include <stdint.h>
    #include <sys/syscall.h>
    #include <sys/uio.h>
    #include <ucontext.h>
    #include <unistd.h>
    /* Copy memory of this process. Returns -1 where it cannot be read, instead of a signal. */
    static inline int tickwork_copy(void *into, uintptr_t from, size_t size) {
        struct iovec local = {into, size}, remote = {(void *)from, size};
        return syscall(SYS_process_vm_readv, getpid(), &local, 1ul, &remote, 1ul, 0ul) == (long)size ? 0 : -1;
    }
    static inline uintptr_t tickwork_program_counter(const void *context) {
    #if defined(__x86_64__)
        return (uintptr_t)((const ucontext_t *)context)->uc_mcontext.gregs[REG_RIP];
    #elif defined(__aarch64__)
        return (uintptr_t)((const ucontext_t *)context)->uc_mcontext.pc;
    #else
        return 0;
    #endif
    }
    static inline uintptr_t tickwork_link(const void *context) {
    #if defined(__aarch64__)
        return (uintptr_t)((const ucontext_t *)context)->uc_mcontext.regs[30];
    #else
        return 0;
    #endif
    }
    static inline uintptr_t tickwork_stack(const void *context) {
    #if defined(__x86_64__)
        return (uintptr_t)((const ucontext_t *)context)->uc_mcontext.gregs[REG_RSP];
    #elif defined(__aarch64__)
        return (uintptr_t)((const ucontext_t *)context)->uc_mcontext.sp;
    #else
        return 0;
    #endif
    }
    """
    uintptr_t tickwork_program_counter(const void *context) noexcept nogil
    uintptr_t tickwork_link(const void *context) noexcept nogil
    uintptr_t tickwork_stack(const void *context) noexcept nogil
    int tickwork_copy(void *into, uintptr_t start, size_t size) noexcept nogil

cdef enum:
    AWAITED = 0                 # answers: this, or 2 + item, 1 for an unknown one
    UNKNOWN = 1
    SAMPLE_LIMIT = 500000       # ns that a sample may take
    PAGE_WORDS = 512
    STACK_PAGES = 16            # in which the return address of a function of the C library is looked for


cdef int item_at(const CodeMap *map, uintptr_t address) noexcept nogil:
    """Return the stopwatch item of the step at an address, or -1 outside the code."""
    cdef int low = 0
    cdef int high = map.count
    cdef int middle
    if address < map.begin or address >= map.end or map.count == 0 or address < map.starts[0]:
        return -1
    while high - low > 1:
        middle = (low + high) // 2
        if map.starts[middle] <= address:
            low = middle
        else:
            high = middle
    return map.items[low]


cdef int item_of_context(const CodeMap *map, const void *context) noexcept nogil:
    """Return the stopwatch item of the step that a signal has interrupted, or -1.

    A function of the C library is found by its return address. A kernel that is called needs no search, which could
    find addresses of previous steps: while it runs, the present item is its own.
    """
    cdef uintptr_t[PAGE_WORDS] words
    cdef uintptr_t stack = tickwork_stack(context) & ~<uintptr_t>7
    cdef int item = item_at(map, tickwork_program_counter(context))
    cdef bint readable = False
    cdef int page, index, count
    if item < 0:
        item = item_at(map, tickwork_link(context))
    for page in range(STACK_PAGES if item < 0 and stack != 0 else 0):
        count = PAGE_WORDS - <int>(stack // sizeof(uintptr_t) % PAGE_WORDS)
        if tickwork_copy(words, stack, count * sizeof(uintptr_t)) == 0:
            readable = True
            for index in range(count):
                item = item_at(map, words[index])
                if item >= 0:
                    return item
        elif readable:                  # the end of the stack; before it, the guard of an exhausted one
            break
        stack += count * sizeof(uintptr_t)
    return item


cdef const CodeMap *sampled = NULL      # global, for the signal handler
cdef int32_t answer = UNKNOWN
cdef action before                      # handler of SIGRTMIN before


cdef void on_sample(int number, siginfo_t *information, void *context) noexcept nogil:
    store_i32(&answer, 2 + item_of_context(sampled, context) if sampled != NULL else UNKNOWN)
    wake(&answer)


cdef int begin_samples(const CodeMap *map) noexcept nogil:
    """Install the handler of samples. map : steps of the machine code, or NULL for no samples"""
    global sampled
    cdef action install
    sampled = map
    if map == NULL:
        return 0
    memset(&install, 0, sizeof(action))
    install.sa_sigaction = on_sample
    install.sa_flags = SA_SIGINFO | SA_RESTART
    return sigaction(SIGRTMIN, &install, &before)


cdef void end_samples() noexcept nogil:
    """Restore the handler before `begin_samples`."""
    global sampled
    if sampled != NULL:
        sigaction(SIGRTMIN, &before, NULL)
    sampled = NULL


cdef int sample(pthread_t thread) noexcept nogil:
    """Return the stopwatch item of the step that a thread executes in machine code, or -1. Takes SAMPLE_LIMIT at most."""
    cdef int64_t until = monotonic() + SAMPLE_LIMIT
    store_i32(&answer, AWAITED)
    if sampled == NULL or pthread_kill(thread, SIGRTMIN) != 0:
        return -1
    while load_i32(&answer) == AWAITED and monotonic() < until:
        doze(&answer, until)
    return max(load_i32(&answer), UNKNOWN) - 2
