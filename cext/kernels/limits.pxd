"""Limits that NaN passes and that turn an infinity into NaN: fmin and fmax would turn either into full torque."""

cdef inline double finite(double x) noexcept nogil:
    """x, or NaN where it is infinite; without a branch, and -0.0 stays -0.0."""
    return x - (x - x)

cdef inline bint is_finite(double x) noexcept nogil:
    return x - x == 0.0

cdef inline double clip(double x, double low, double high) noexcept nogil:
    """x inside [low, high]; NaN where x is not finite, also where an end is infinite."""
    x = finite(x)
    x = low if low > x else x   # NaN fails both comparisons; without branches, which mispredict with the data
    return high if high < x else x

cdef inline double toward(double previous, double target, double most) noexcept nogil:
    """From previous to target by at most `most`; never past the target, so never outside an interval that holds both.

    NaN where the target is not finite.
    """
    cdef double change
    target = finite(target)
    change = target - previous
    if change > most:
        return previous + most
    if change < -most:
        return previous - most
    return target               # NaN too
