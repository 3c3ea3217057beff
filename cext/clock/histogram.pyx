# cython: freethreading_compatible=True
"""Percentiles of histograms."""

from libc.string cimport memset

from cext.clock.deadline_clock cimport clock
from cext.posix cimport CLOCK_THREAD_CPUTIME_ID


cdef dict summary(const Histogram *histogram):
    """Return percentiles in s, if there are any.

    Each is the upper edge of its bucket, so never below the true value.
    """
    cdef uint64_t seen = 0
    cdef int bucket
    result = {
        "count": histogram.count, "total": histogram.total * 1e-9, "max": histogram.largest * 1e-9,
        "max_at_tick": histogram.largest_at,
    }
    wanted = [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)]
    for bucket in range(BUCKETS):
        seen += histogram.buckets[bucket]
        while wanted and histogram.count and seen >= wanted[0][1] * histogram.count:
            result[wanted.pop(0)[0]] = min(lower_edge(bucket + 1), histogram.largest) * 1e-9
    return result


def percentiles(durations) -> dict[str, float]:
    """Return the percentiles of durations in ns, as in the statistics: a dict in s, each at most 3.2 % above the
    true value.
    """
    cdef Histogram histogram
    memset(&histogram, 0, sizeof(Histogram))
    for index, ns in enumerate(durations):
        add(&histogram, ns, index)
    return summary(&histogram)


def counts_of(durations) -> np.ndarray:
    """Return the bucket counts of durations in ns, as an array that can be added to others."""
    cdef Histogram histogram
    memset(&histogram, 0, sizeof(Histogram))
    for ns in durations:
        add(&histogram, ns, 0)
    return buckets(&histogram)


cdef object buckets(const Histogram *histogram):
    import numpy as np                          # the recorder process uses this module without NumPy

    return np.asarray(<uint64_t[:BUCKETS]>(<uint64_t *>histogram.buckets)).copy()


def percentile(uint64_t[::1] counts, double share) -> float:
    """Return a percentile in s, at most 3.2 % above the true value.

    counts : of `counts_of` or SharedState
    share : 0 to 1
    """
    cdef uint64_t seen = 0
    cdef uint64_t total = 0
    cdef double wanted
    cdef int bucket
    for bucket in range(BUCKETS):
        total += counts[bucket]
    wanted = share * total
    for bucket in range(BUCKETS):
        seen += counts[bucket]
        if seen > 0 and seen >= wanted:
            return lower_edge(bucket + 1) * 1e-9
    raise ValueError("the histogram is empty: it has no percentiles")


def time_of_add(int64_t[::1] durations, int64_t rounds) -> float:
    """Return the ns of processor time of one `add`, measured over `rounds` times all durations. For `bench`."""
    cdef Histogram histogram
    cdef int64_t began, round
    cdef Py_ssize_t index
    memset(&histogram, 0, sizeof(Histogram))
    began = clock(CLOCK_THREAD_CPUTIME_ID)
    for round in range(rounds):
        for index in range(durations.shape[0]):
            add(&histogram, durations[index], index)
    return (clock(CLOCK_THREAD_CPUTIME_ID) - began) / <double>histogram.count
