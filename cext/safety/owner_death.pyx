# cython: freethreading_compatible=True
"""Early detection that the loop's thread has died: a thread that waits for the robust mutex in the shared state.

It never takes the GIL, only waits, and lasts as long as its process.
"""

import os

from cpython.ref cimport Py_INCREF
from libc.stdint cimport uint64_t
from posix.unistd cimport write

from cext.memory.robust_mutex cimport EOWNERDEAD, pthread_mutex_lock, pthread_mutex_unlock
from cext.memory.shared_state cimport SharedState
from cext.posix cimport pthread_t
from cext.threads cimport be_called, start_thread

cdef size_t STACK = 64 << 10            # bytes


cdef class OwnerDeathWatcher:
    """Thread that waits for the death of the mutex's owner. Raises OSError.

    shared : SharedState whose mutex another process holds
    priority : of SCHED_FIFO if granted, 0 for an ordinary thread

    fd : eventfd that is readable once the owner has died without releasing the mutex
    """
    cdef SharedState shared
    cdef readonly int fd
    cdef int priority

    def __init__(self, SharedState shared, int priority=0):
        cdef pthread_t thread
        cdef int failed
        self.shared, self.priority = shared, priority
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        # never released: the thread waits in the kernel and cannot be ended
        Py_INCREF(self)
        failed = start_thread(&thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "cannot start the thread that waits for the end of the loop")

    cdef void wait(self) noexcept nogil:
        cdef uint64_t one = 1
        cdef int status
        be_called("tickwork-death", self.priority)
        status = pthread_mutex_lock(&self.shared.layout.hold)
        if status == EOWNERDEAD:
            write(self.fd, &one, sizeof(one))
        elif status == 0:
            pthread_mutex_unlock(&self.shared.layout.hold)


cdef void *enter(void *context) noexcept nogil:
    (<OwnerDeathWatcher>context).wait()
    return NULL
