"""Compensated sums, which do not drift."""

cdef enum: # indices in `sums`
    RUNNING, RUNNING_REST, FRESH, FRESH_REST

cdef inline void add(double *total, double x) noexcept nogil:
    """Add x to total[0] + total[1]; total[1] holds the rounding error.

    (Ogita, Rump and Oishi, Accurate sum and dot product, 2005)
    """
    cdef double s = total[0] + x
    cdef double back = s - total[0]
    total[1] += (total[0] - (s - back)) + (x - back)
    total[0] = s

cdef inline void begin_anew(double *sums) noexcept nogil:
    """Replace the running sum by the fresh sum of the whole window, so that no rounding error outlives two windows."""
    sums[RUNNING] = sums[FRESH]
    sums[RUNNING_REST] = sums[FRESH_REST]
    sums[FRESH] = sums[FRESH_REST] = 0.0
