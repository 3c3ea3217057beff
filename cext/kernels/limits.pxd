"""Limits that pass NaN and turn an infinity into NaN; fmin and fmax would turn either into full torque."""

cdef inline double finite(double x) noexcept nogil:
    """Return x, or NaN if it is infinite, without a branch; -0.0 stays -0.0."""
    return x - (x - x)

cdef inline bint is_finite(double x) noexcept nogil:
    cdef double zero = x - x    # or NaN, which differs from itself
    return zero == zero

cdef inline double clip(double x, double low, double high) noexcept nogil:
    """Return x clamped to [low, high]; NaN if x is not finite, even if a bound is infinite."""
    cdef double zero = x - x    # or NaN; subtracted at the end, since the comparisons need not wait for it
    x = low if low > x else x   # NaN fails both comparisons; without branches, which mispredict with the data
    x = high if high < x else x
    return x - zero

cdef inline double toward(double previous, double target, double most) noexcept nogil:
    """Move from previous to target by at most `most`, without overshoot.

    Returns NaN if the target is not finite.
    """
    cdef double change
    target = finite(target)
    change = target - previous
    if change > most:
        return previous + most
    if change < -most:
        return previous - most
    return target               # also NaN
