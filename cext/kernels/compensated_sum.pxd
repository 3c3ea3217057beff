"""Sums that do not drift."""

cdef enum: # of the doubles behind `sums` below
    RUNNING, RUNNING_REST, FRESH, FRESH_REST

cdef inline void add(double *total, double x) noexcept nogil:
    """total[0] + total[1] += x, what rounding loses kept in total[1]. (Ogita, Rump and Oishi, Accurate sum and dot product, 2005)"""
    cdef double s = total[0] + x
    cdef double back = s - total[0]
    total[1] += (total[0] - (s - back)) + (x - back)
    total[0] = s

cdef inline void begin_anew(double *sums) noexcept nogil:
    """The fresh sum, that of the whole window now, replaces the running one, so that no rounding is older than two windows."""
    sums[RUNNING] = sums[FRESH]
    sums[RUNNING_REST] = sums[FRESH_REST]
    sums[FRESH] = sums[FRESH_REST] = 0.0
