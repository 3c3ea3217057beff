# cython: freethreading_compatible=True
"""The signals that end a run. Python's own handlers would wait for the end of the loop, so it has its own: they set a flag."""

from libc.string cimport memset

from cext.posix cimport SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, sigaction

cdef int32_t first = 0                   # a handler has nowhere else to put it
cdef int[ENDING] SIGNALS = [SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1]


cdef void on_signal(int number) noexcept nogil:
    global first
    if first == 0:
        first = number


cdef class Signals:
    """SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGUSR1, from `take` to `give_back`.

    handled : False leaves the handlers of the process in place, and no signal ends the run
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
        """Install the handlers; again where a block may have replaced them. before : what they replace, or NULL"""
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
