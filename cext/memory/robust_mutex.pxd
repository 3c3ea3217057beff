"""Robust shared mutex used as a liveness token: the kernel returns EOWNERDEAD to waiters when the owner dies."""

from libc.stdint cimport int32_t

from cext.atomics cimport load_i32, store_i32

cdef extern from *:
    """
    #include <errno.h>
    #include <pthread.h>

    /* A robust mutex in shared memory. The kernel releases those of a dying thread first, before it frees the memory of
    the process, which a pidfd waits for: with locked memory that can take 20 ms. */
    static int tw_hold_make(pthread_mutex_t *hold) {
        pthread_mutexattr_t kind;
        int failed = pthread_mutexattr_init(&kind);
        if (failed)
            return failed;
        pthread_mutexattr_setpshared(&kind, PTHREAD_PROCESS_SHARED);
        pthread_mutexattr_setrobust(&kind, PTHREAD_MUTEX_ROBUST);
        pthread_mutexattr_settype(&kind, PTHREAD_MUTEX_ERRORCHECK);
        failed = pthread_mutex_init(hold, &kind);
        pthread_mutexattr_destroy(&kind);
        return failed;
    }
    """
    ctypedef struct pthread_mutex_t:
        pass
    int make_hold "tw_hold_make"(pthread_mutex_t *hold) noexcept nogil
    int pthread_mutex_lock(pthread_mutex_t *hold) noexcept nogil
    int pthread_mutex_trylock(pthread_mutex_t *hold) noexcept nogil
    int pthread_mutex_unlock(pthread_mutex_t *hold) noexcept nogil
    const int EOWNERDEAD
    const int EDEADLK


cdef inline bint find_dead(pthread_mutex_t *hold, int32_t *dead) noexcept nogil:
    """Return whether the owning thread has died. dead : stores the result, which the kernel reports once

    A mutex that another thread holds is not touched, and no system call is made.
    """
    cdef int status
    if load_i32(dead):
        return True
    status = pthread_mutex_trylock(hold)
    if status == EOWNERDEAD:
        store_i32(dead, 1)
    if status == 0 or status == EOWNERDEAD:
        # else the kernel's list of held mutexes would point to unmapped memory
        pthread_mutex_unlock(hold)
    return status == EOWNERDEAD
