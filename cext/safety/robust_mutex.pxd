"""A hold on life: who has it is there; when its thread dies, the kernel tells who waits for it."""

from libc.stdint cimport int32_t

from cext.atomics cimport load_i32, store_i32

cdef extern from *:
    """
    #include <errno.h>
    #include <pthread.h>

    /* A robust mutex in shared memory. The kernel gives up those of a dying thread first of all, long before it has taken back the memory of
       the process, which is what a pidfd waits for: with locked memory that can take 20 ms. */
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
    """Whether the thread that had it has died. dead : where that is kept, for it is told once

    One that another thread has is left as it is, without a system call.
    """
    cdef int status
    if load_i32(dead):
        return True
    status = pthread_mutex_trylock(hold)
    if status == EOWNERDEAD:
        store_i32(dead, 1)
    if status == 0 or status == EOWNERDEAD:
        pthread_mutex_unlock(hold)                  # who still had it when its memory goes would have a list that leads nowhere
    return status == EOWNERDEAD
