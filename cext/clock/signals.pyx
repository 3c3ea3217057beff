# cython: freethreading_compatible=True
"""Signals that end a run. Python's handlers run only after the loop, so these handlers set a flag for the loop."""

from libc.string cimport memset

from cext.posix cimport SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, sigaction

cdef int32_t first = 0                   # global, for the signal handler
cdef int[ENDING] SIGNALS = [SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1]


cdef void on_signal(int number) noexcept nogil:
    global first
    if first == 0:
        first = number


cdef class Signals:
    """Handlers of SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGUSR1, from `take` to `give_back`.

    handled : False keeps the handlers of the process, and no signal ends the run
    """

    def __cinit__(self, bint handled=True):
        self.handled = handled
        self.caught = &first if handled else &self.never

    cdef void take(self):
        global first
        if not self.handled:
            return
        first = 0
        self.install(self.before)

    cdef void install(self, action *before) noexcept nogil:
        """Install the handlers, again if a block may have replaced them.

        before : receives the replaced ones, or NULL
        """
        cdef action ours
        cdef int index
        if not self.handled:
            return
        memset(&ours, 0, sizeof(action))
        ours.sa_handler = on_signal
        for index in range(ENDING):
            sigaction(SIGNALS[index], &ours, NULL if before == NULL else &before[index])

    cdef void give_back(self):
        cdef int index
        if not self.handled:
            return
        for index in range(ENDING):
            sigaction(SIGNALS[index], &self.before[index], NULL)
