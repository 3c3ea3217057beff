"""Limits that let NaN pass: fmin and fmax would turn it into full torque."""

cdef inline double clip(double x, double low, double high) noexcept nogil:
    x = low if low > x else x   # NaN fails both comparisons; without branches, which mispredict with the data
    return high if high < x else x

cdef inline double toward(double previous, double target, double most) noexcept nogil:
    """From previous to target by at most `most`; never past the target, so never outside an interval that holds both."""
    cdef double change = target - previous
    if change > most:
        return previous + most
    if change < -most:
        return previous - most
    return target               # NaN too
