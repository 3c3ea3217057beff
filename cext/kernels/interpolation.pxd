"""Search in ascending knots, and linear interpolation."""


cdef inline int segment(const double *knots, int count, double x) noexcept nogil:
    """Return index i of the piece knots[i] to knots[i + 1] that contains x, clamped to the first and last piece.

    count : of knots, at least 2
    """
    cdef int first = 0
    cdef int pieces = count - 1
    cdef int half
    while pieces > 1:
        half = pieces >> 1
        first += half if knots[first + half] <= x else 0
        pieces -= half
    return first


cdef inline double between(double a, double b, double share) noexcept nogil:
    """Interpolate between a and b and clamp, since rounding could leave the interval that the proof assumes."""
    cdef double y
    if share <= 0.0:
        return a
    if share >= 1.0:
        return b
    y = (1.0 - share) * a + share * b                       # b - a could overflow
    if a <= b:
        return a if y < a else b if y > b else y
    return b if y < b else a if y > a else y


cdef inline double along(double a, double b, double share) noexcept nogil:
    """Interpolate or extrapolate on the line through a and b."""
    if share < 0.0:
        return a + share * (b - a)
    if share > 1.0:
        return b + (share - 1.0) * (b - a)
    return between(a, b, share)


cdef inline double share_of(const double *knots, int i, double x) noexcept nogil:
    """Return the position of x between knots[i] and the next knot, as a fraction."""
    return (x - knots[i]) / (knots[i + 1] - knots[i])
