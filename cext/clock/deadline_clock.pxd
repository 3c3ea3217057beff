from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.posix cimport CLOCK_BOOTTIME, CLOCK_MONOTONIC, clock_gettime, timespec

cdef extern from *:
    """
    #include <stdint.h>
    /* k times a fraction of 2**64, rounded. */
    static inline int64_t tw_share(int64_t k, uint64_t share) {
        return (int64_t)(((unsigned __int128)k * share + ((uint64_t)1 << 63)) >> 64);
    }
    #if defined(__x86_64__) || defined(__i386__)
    #define tw_pause() __builtin_ia32_pause()
    #elif defined(__aarch64__)
    #define tw_pause() __asm__ volatile("yield")
    #else
    #define tw_pause() ((void)0)
    #endif
    """
    int64_t share_of "tw_share"(int64_t k, uint64_t share) noexcept nogil
    void pause "tw_pause"() noexcept nogil

cdef inline int64_t clock(int which) noexcept nogil:
    cdef timespec now
    clock_gettime(which, &now)
    return <int64_t>now.tv_sec * 1000000000 + now.tv_nsec

cdef inline int64_t monotonic() noexcept nogil:
    return clock(CLOCK_MONOTONIC)

cdef inline int64_t suspended_time() noexcept nogil:
    """Return the ns for which this computer has been suspended since it was started.

    CLOCK_MONOTONIC stands still meanwhile, CLOCK_BOOTTIME does not. CLOCK_MONOTONIC is read second, so that a delay
    between the two makes the result smaller, never larger.
    """
    cdef int64_t boot = clock(CLOCK_BOOTTIME)
    return boot - monotonic()

cdef class DeadlineClock:
    cdef readonly double rate        # Hz
    cdef int64_t period              # ns, rounded
    cdef int64_t whole               # ns of a period, integer part
    cdef uint64_t share              # and 2**64 times the fraction
    cdef int64_t window              # ns before a deadline in which it spins
    cdef readonly int64_t sleeps     # number of sleeps
    cdef readonly int64_t spins      # number of spins
    cdef const int32_t *caught

    cpdef int64_t grid(self, int64_t tick) noexcept nogil
    cpdef int64_t newest(self, int64_t ns) noexcept nogil
    cdef void wait(self, int64_t deadline) noexcept nogil
    cdef void sleep_until(self, int64_t deadline) noexcept nogil
