"""Comparison of two measurements of one quantity over a second, which detects a table or firmware with another scale.

Principle
    1. For pairs (x, y) that should be equal, the sums of x², y² and x y are kept. √(Σy²/Σx²) is the scale, independent
       of any lag; Σxy/Σx² is the scale, independent of any noise in y. Both must deviate to the same side: the first by
       the tolerance, the second by a third of it. Or the first is above 3, which noise cannot cause, or the second
       below -0.5: the signs differ.
    2. Velocity: x is the change of position in at least 25 ms, y the integral of the reported velocity. Counted if
       either is faster than 0.5 rad/s; not if either is at an end of its range, nor over a gap of more than 30 ms, in
       which an ankle's velocity rises and falls. Below 33 replies per second nothing is counted.
    3. Torque: x is the sent law, y the measured torque. Counted above 10 % of the rated torque, and not if the law
       exceeds half of the rated torque, where a drive may limit it.
"""

from libc.math cimport fabs, fmax, isinf, log, sqrt
from libc.stdint cimport int64_t

from cext.safety.thresholds cimport SCALE_SPEED_MINIMUM, SCALE_TIME

cdef enum:
    CHUNK = 25000000                    # ns
    GAP = 30000000                      # ns
    PLAIN = 300                         # %, excess of a scale that noise cannot cause; x may be zero
    ENDS = 990                          # 0.001 of a range; positions beyond are at its end

cdef struct Scale:
    double tolerance                    # ln of the permitted factor
    double xx, yy, xy
    double time                         # s

cdef struct Way:                        # way in one chunk
    int64_t began, time                 # ns, of its first and newest reply
    double start                        # rad
    double velocity                     # rad/s
    double integral                     # rad
    bint runs


cdef inline void forget_scale(Scale *scale) noexcept nogil:
    scale.xx = scale.yy = scale.xy = scale.time = 0.0


cdef inline double compare(Scale *scale, double x, double y, double time) noexcept nogil:
    """Add a pair that has held for `time` s. Returns the scale of y over x if it deviates after a second, else 0."""
    cdef double ratio, slope, off
    scale.xx += x * x
    scale.yy += y * y
    scale.xy += x * y
    scale.time += time
    if scale.time < 1e-9 * SCALE_TIME - 1e-6:
        return 0.0
    ratio = sqrt(scale.yy / fmax(scale.xx, 1e-6 * scale.yy + 1e-30))
    slope = scale.xy / fmax(scale.xx, 1e-6 * scale.yy + 1e-30)
    forget_scale(scale)
    if isinf(scale.tolerance):
        return 0.0
    if ratio > 1e-2 * PLAIN:
        return ratio
    if slope < -0.5:
        return slope
    off = log(fmax(ratio, 1e-30))
    if fabs(off) <= scale.tolerance:
        return 0.0
    off = log(fmax(slope, 1e-30)) * (1.0 if off > 0.0 else -1.0)
    return fmax(ratio, 1e-3) if off > scale.tolerance / 3.0 else 0.0


cdef inline double follow(
        Way *way, Scale *scale, int64_t time, double position, double velocity, double longest,
        bint counts) noexcept nogil:
    """Add a reply.

    longest : rad, of a chunk; a larger change of position is a wrap-around
    counts : whether neither is at an end of its range
    """
    cdef double elapsed = 1e-9 * (time - way.time)
    cdef double length, gone
    cdef double off = 0.0
    if way.runs and counts and time - way.time <= GAP:
        way.integral += 0.5 * (velocity + way.velocity) * elapsed
        length = 1e-9 * (time - way.began)
        if time - way.began >= CHUNK:
            gone = position - way.start
            if fabs(gone) < longest and fmax(fabs(gone), fabs(way.integral)) >= 1e-3 * SCALE_SPEED_MINIMUM * length:
                off = compare(scale, gone, way.integral, length)
            way.runs = False
    else:
        way.runs = False
    if counts and not way.runs:
        way.runs, way.began, way.start, way.integral = True, time, position, 0.0
    way.time, way.velocity = time, velocity
    return off
