"""Taring: what a sensor says without a load is measured as a mean and taken away from then on."""

cdef enum: # of the memory of a tare
    ZERO                        # that is taken away
    SUM                         # of what was measured in this tare,
    COUNTED                     # in so many samples,
    WANTED                      # of so many
    RUNNING                     # whether it goes on
    ASKED                       # whether it was asked for a sample ago
    TARE_WORDS


cdef inline double tared(double *tare, double x, bint asked) noexcept nogil:
    """x without its zero. A tare begins where it is asked for anew; while it goes on the mean of what has come so far is the zero."""
    if asked and tare[ASKED] == 0.0:
        tare[SUM], tare[COUNTED], tare[RUNNING] = 0.0, 0.0, 1.0
    tare[ASKED] = asked
    if tare[RUNNING] != 0.0 and x - x == 0.0:
        tare[SUM] += x
        tare[COUNTED] += 1.0
        tare[ZERO] = tare[SUM] / tare[COUNTED]
        if tare[COUNTED] >= tare[WANTED]:
            tare[RUNNING] = 0.0
    return x - tare[ZERO]
