# cython: freethreading_compatible=True
"""The signals that end a run. Python's own handlers would wait for the end of the loop, so it has its own: they set a flag."""

from libc.string cimport memset

from cext.posix cimport SIGHUP, SIGINT, SIGTERM, sigaction

cdef int32_t first = 0                   # a handler has nowhere else to put it
cdef int[3] SIGNALS = [SIGINT, SIGTERM, SIGHUP]


cdef void on_signal(int number) noexcept nogil:
    global first
    if first == 0:
        first = number


cdef class Signals:
    """SIGINT, SIGTERM and SIGHUP, from `take` to `give_back`."""

    def __cinit__(self):
        self.caught = &first

    cdef void take(self):
        global first
        cdef action install
        cdef int index
        first = 0
        memset(&install, 0, sizeof(action))
        install.sa_handler = on_signal
        for index in range(3):
            sigaction(SIGNALS[index], &install, &self.before[index])

    cdef void give_back(self):
        cdef int index
        for index in range(3):
            sigaction(SIGNALS[index], &self.before[index], NULL)
