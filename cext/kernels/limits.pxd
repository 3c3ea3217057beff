"""Limits that pass NaN and turn an infinity into NaN; fmin and fmax would turn either into full torque."""

from libc.math cimport fabs

cdef extern from *:
    # Macro of Cython. Compilers make a branch of the condition, whose result the steps that follow need not wait for.
    bint unlikely(bint condition) noexcept nogil

cdef inline double finite(double x) noexcept nogil:
    """Return x, or NaN if it is infinite, without a branch; -0.0 stays -0.0."""
    return x - (x - x)

cdef inline bint is_finite(double x) noexcept nogil:
    cdef double zero = x - x    # or NaN, which differs from itself
    return zero == zero

cdef inline double clip(double x, double low, double high) noexcept nogil:
    """Return x clamped to [low, high]; NaN if x is not finite, even if a bound is infinite."""
    cdef double zero = x - x    # or NaN; subtracted at the end, since the comparisons need not wait for it
    x = x if x > low else low   # without branches, which mispredict with the data; NaN becomes a bound here
    x = x if x < high else high
    return x - zero

cdef inline double toward(double previous, double target, double most) noexcept nogil:
    """Move from previous to target by at most `most`, without overshoot.

    Returns NaN if the target is not finite.
    """
    cdef double zero = target - target
    cdef double change = target - previous
    if fabs(change) > most:
        return previous + (most if change > 0.0 else -most) - zero
    return target - zero        # also NaN
