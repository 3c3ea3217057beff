# cython: freethreading_compatible=True
"""Signals that end a run. Python's handlers run only after the loop, so these handlers set a flag for the loop."""

from libc.stdint cimport int64_t
from libc.string cimport memset

from cext.clock.deadline_clock cimport monotonic
from cext.posix cimport (
    SIG_SETMASK, SIG_UNBLOCK, SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, pthread_sigmask, sigaction, sigaddset,
    sigemptyset,
)

cdef int64_t RESPONSE_LIMIT = 1_000_000_000      # ns in which the loop responds to a signal
cdef int32_t first = 0                   # global, for the signal handler
cdef int64_t since = 0                   # ns of CLOCK_MONOTONIC of the first
cdef ignored_t ignored = NULL
cdef int[ENDING] SIGNALS = [SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1]


cdef void on_signal(int number) noexcept nogil:
    global first, since
    if first == 0:
        since, first = monotonic(), number
    elif ignored != NULL and monotonic() - since > RESPONSE_LIMIT:
        ignored()


cdef void unblock(sigset_t *before) noexcept nogil:
    """Unblock the signals that end a run in the calling thread. before : receives its mask, or NULL"""
    cdef sigset_t ours
    cdef int index
    sigemptyset(&ours)
    for index in range(ENDING):
        sigaddset(&ours, SIGNALS[index])
    pthread_sigmask(SIG_UNBLOCK, &ours, before)


cdef class Signals:
    """Handlers of SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGUSR1, from `take` to `give_back`.

    handled : False keeps the handlers of the process, and no signal ends the run
    """

    def __cinit__(self, bint handled=True):
        self.handled = handled
        self.caught = &first if handled else &self.never

    cdef void take(self):
        global first, ignored
        if not self.handled:
            return
        first, ignored = 0, self.ignored
        self.install(self.before, &self.mask)

    cdef void install(self, action *before, sigset_t *mask) noexcept nogil:
        """Install the handlers and unblock their signals, again if a block may have replaced or blocked them.

        before, mask : receive the replaced handlers and the signal mask of the thread, or NULL
        """
        cdef action ours
        cdef int index
        if not self.handled:
            return
        memset(&ours, 0, sizeof(action))
        ours.sa_handler = on_signal
        for index in range(ENDING):
            sigaction(SIGNALS[index], &ours, NULL if before == NULL else &before[index])
        unblock(mask)

    cdef void give_back(self):
        cdef int index
        if not self.handled:
            return
        for index in range(ENDING):
            sigaction(SIGNALS[index], &self.before[index], NULL)
        pthread_sigmask(SIG_SETMASK, &self.mask, NULL)
