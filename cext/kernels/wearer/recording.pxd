"""Recorded motion of both legs, repeated."""

from libc.math cimport floor

from cext.kernels.wearer.reference cimport Path

cdef enum: # of a sample: angle and velocity of hip, knee, ankle, left and right, then
    LEFT_PHASE = 12             # unwrapped, in strides
    RIGHT_PHASE
    STRIDE                      # 1 in a walk, 0 in a stand
    SAMPLE


cdef inline void play(const double *samples, int count, double time, Path *q, Path *phases,
        double *stride) noexcept nogil:
    """Interpolate the samples at a time, by cubics through their angles and velocities.

    samples : their rate in Hz, then SAMPLE numbers each; q : three joints of the left leg, then of the right one
    """
    cdef double rate = samples[0]
    cdef double place = time * rate
    cdef double x, x2, d, a, b
    cdef const double *now
    cdef const double *next
    cdef int j
    place -= (count - 1) * floor(place / (count - 1))
    j = <int>place
    if j > count - 2:
        j = count - 2
    x = place - j
    x2 = x * x
    now = samples + 1 + SAMPLE * j
    next = now + SAMPLE
    for j in range(6):
        d = next[2 * j] - now[2 * j]
        a = now[2 * j + 1] / rate
        b = next[2 * j + 1] / rate
        q[j].x = now[2 * j] + x * a + x2 * (3.0 * d - 2.0 * a - b) + x2 * x * (a + b - 2.0 * d)
        q[j].v = rate * (a + 2.0 * x * (3.0 * d - 2.0 * a - b) + 3.0 * x2 * (a + b - 2.0 * d))
        q[j].a = rate * rate * (2.0 * (3.0 * d - 2.0 * a - b) + 6.0 * x * (a + b - 2.0 * d))
    for j in range(2):
        d = next[LEFT_PHASE + j] - now[LEFT_PHASE + j]
        phases[j].x = now[LEFT_PHASE + j] + x * d
        phases[j].x -= floor(phases[j].x)
        phases[j].v = rate * d
        phases[j].a = 0.0
    stride[0] = now[STRIDE] + x * (next[STRIDE] - now[STRIDE])
