# cython: freethreading_compatible=True
"""Tells that the loop's thread has died, sooner than its process is gone: a thread that waits for the hold on the shared page.

It never takes the GIL, and does nothing but wait. It lasts as long as its process.
"""

import os

from cpython.ref cimport Py_INCREF
from libc.stdint cimport uint64_t
from posix.unistd cimport write

from cext.safety.robust_mutex cimport EOWNERDEAD, pthread_mutex_lock, pthread_mutex_unlock
from cext.safety.shared_state cimport Page
from cext.posix cimport pthread_t
from cext.threads cimport be_called, start_thread

cdef size_t STACK = 64 << 10            # bytes


cdef class Mourner:
    """page : Page whose hold another process has; priority : of SCHED_FIFO where that is granted, 0 for an ordinary thread. OSError

    fd : an eventfd that can be read once the holder has died without letting go
    """
    cdef Page page
    cdef readonly int fd
    cdef int priority

    def __init__(self, Page page, int priority=0):
        cdef pthread_t thread
        cdef int failed
        self.page, self.priority = page, priority
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        Py_INCREF(self)                                                 # for good: its thread waits in the kernel, and cannot be ended
        failed = start_thread(&thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "there is no thread that waits for the loop's end")

    cdef void wait(self) noexcept nogil:
        cdef uint64_t one = 1
        cdef int status
        be_called("tickwork-mourn", self.priority)
        status = pthread_mutex_lock(&self.page.layout.hold)
        if status == EOWNERDEAD:
            write(self.fd, &one, sizeof(one))
        elif status == 0:
            pthread_mutex_unlock(&self.page.layout.hold)


cdef void *enter(void *context) noexcept nogil:
    (<Mourner>context).wait()
    return NULL
