"""Taring: the mean of a sensor's reading without load, subtracted from then on."""

cdef enum: # places in the memory of a tare
    ZERO                        # value to subtract
    SUM                         # sum of the samples of this tare
    COUNTED                     # number of samples in the sum
    WANTED                      # number of samples of a tare
    RUNNING                     # whether a tare is in progress
    ASKED                       # whether it was requested one sample ago
    TARE_WORDS


cdef inline double tared(double *tare, double x, bint asked) noexcept nogil:
    """Return x minus the zero. A rising request starts a tare; until it ends, the zero is the mean so far."""
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
