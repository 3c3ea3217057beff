"""Where a number lies among knots that rise, and what lies between two values."""


cdef inline int segment(const double *knots, int count, double x) noexcept nogil:
    """Index i of the piece knots[i] to knots[i + 1] that holds x; the first or the last piece beyond the ends. count >= 2."""
    cdef int first = 0
    cdef int pieces = count - 1
    cdef int half
    while pieces > 1:
        half = pieces >> 1
        first += half if knots[first + half] <= x else 0
        pieces -= half
    return first


cdef inline double between(double a, double b, double share) noexcept nogil:
    """On the line from a to b, and never past either: rounding would leave an interval that was proved."""
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
    """On the line through a and b, beyond them too."""
    if share < 0.0:
        return a + share * (b - a)
    if share > 1.0:
        return b + (share - 1.0) * (b - a)
    return between(a, b, share)


cdef inline double share_of(const double *knots, int i, double x) noexcept nogil:
    """How far x is on the way from knots[i] to the next."""
    return (x - knots[i]) / (knots[i + 1] - knots[i])
