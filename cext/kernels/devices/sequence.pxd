"""Order of numbered frames: whether one is ahead of the newest, and how many are missing before it.

A frame that is not ahead is late or repeated: it gives no value. A sender that restarts counts from its first number
again: a frame that is more than LATEST behind, that comes after SILENCE, or that is the last of RESTART in a row that
are not ahead begins again.
"""

from libc.stdint cimport uint32_t

cdef enum: # in a memory of three numbers
    NEXT                        # number of the next frame, -1: any
    BEHIND                      # frames in a row that were not ahead
    NEWEST                      # arrival of the newest frame, s

cdef enum:
    LATEST = 64
    RESTART = 8
    SILENCE = 200               # ms

cdef inline int missing_before(double *sequence, uint32_t number, uint32_t mask, double came) noexcept nogil:
    """Store the number of a frame. Returns how many are missing before it, or -1 if it is not ahead.

    mask : at which numbers wrap; came : s, arrival
    """
    cdef uint32_t gap = 0 if sequence[NEXT] < 0.0 else (number - <uint32_t>sequence[NEXT]) & mask
    if gap > mask // 2:
        sequence[BEHIND] += 1.0
        if mask + 1 - gap <= LATEST and sequence[BEHIND] < RESTART and came - sequence[NEWEST] < 1e-3 * SILENCE:
            return -1
        gap = 0
    sequence[NEXT], sequence[BEHIND], sequence[NEWEST] = <double>((number + 1) & mask), 0.0, came
    return <int>gap
