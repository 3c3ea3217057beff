# cython: freethreading_compatible=True
"""Tells that the loop's thread has died, sooner than its process is gone: a thread that waits for the hold on the shared page.

It never takes the GIL, and does nothing but wait. It lasts as long as its process.
"""

import os

from cpython.ref cimport Py_INCREF
from libc.stdint cimport uint64_t
from posix.unistd cimport write

from cext.hold cimport EOWNERDEAD, pthread_mutex_lock, pthread_mutex_unlock
from cext.page cimport Page
from cext.posix cimport (
    PR_SET_NAME, SCHED_FIFO, SCHED_RESET_ON_FORK, SIG_SETMASK, prctl, pthread_attr_destroy, pthread_attr_init, pthread_attr_setstacksize,
    pthread_attr_t, pthread_create, pthread_sigmask, pthread_t, sched_param, sched_setscheduler, sigfillset, sigset_t,
)

cdef size_t STACK = 64 << 10            # bytes


cdef class Mourner:
    """page : Page whose hold another process has; priority : of SCHED_FIFO where that is granted, 0 for an ordinary thread. OSError

    fd : an eventfd that can be read once the holder has died without letting go
    """
    cdef Page page
    cdef readonly int fd
    cdef int priority

    def __init__(self, Page page, int priority=0):
        cdef pthread_attr_t attributes
        cdef pthread_t thread
        cdef sigset_t everything, mine
        cdef int failed
        self.page, self.priority = page, priority
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        Py_INCREF(self)                                                 # for good: its thread waits in the kernel, and cannot be ended
        pthread_attr_init(&attributes)
        pthread_attr_setstacksize(&attributes, STACK)
        sigfillset(&everything)
        pthread_sigmask(SIG_SETMASK, &everything, &mine)
        failed = pthread_create(&thread, &attributes, enter, <void *>self)
        pthread_sigmask(SIG_SETMASK, &mine, NULL)
        pthread_attr_destroy(&attributes)
        if failed:
            raise OSError(failed, "there is no thread that waits for the loop's end")

    cdef void wait(self) noexcept nogil:
        cdef sched_param parameters
        cdef uint64_t one = 1
        cdef int status
        prctl(PR_SET_NAME, <unsigned long><const char *>"tickwork-mourn")
        if self.priority > 0:
            parameters.sched_priority = self.priority
            sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters)
        status = pthread_mutex_lock(&self.page.layout.hold)
        if status == EOWNERDEAD:
            write(self.fd, &one, sizeof(one))
        elif status == 0:
            pthread_mutex_unlock(&self.page.layout.hold)


cdef void *enter(void *context) noexcept nogil:
    (<Mourner>context).wait()
    return NULL
