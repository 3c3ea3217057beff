"""Histogram of durations in constant memory: 32 buckets per octave, so that a percentile is exact within 3 %."""

from libc.stdint cimport int64_t, uint64_t

cdef extern from *:
    int clz "__builtin_clzll"(unsigned long long value) noexcept nogil

cdef enum:
    BITS = 5                         # 2**BITS buckets an octave
    BUCKETS = (64 - BITS) << BITS

cdef struct Histogram:
    uint64_t count
    int64_t total                    # ns
    int64_t largest                  # ns
    int64_t largest_at               # tick of the largest
    uint64_t buckets[BUCKETS]

cdef inline void add(Histogram *histogram, int64_t ns, int64_t tick) noexcept nogil:
    cdef uint64_t value = <uint64_t>ns if ns > 0 else 0
    cdef int shift = 63 - BITS - clz(value | (1 << BITS))
    histogram.buckets[(shift << BITS) + <int>(value >> shift)] += 1
    histogram.count += 1
    histogram.total += ns
    if ns > histogram.largest or histogram.count == 1:
        histogram.largest = ns
        histogram.largest_at = tick

cdef inline int64_t lower_edge(int bucket) noexcept nogil:
    cdef int shift = (bucket >> BITS) - 1
    if shift < 0:
        return bucket
    return <int64_t>((bucket & ((1 << BITS) - 1)) + (1 << BITS)) << shift

cdef dict summary(const Histogram *histogram)
cdef object buckets(const Histogram *histogram)
