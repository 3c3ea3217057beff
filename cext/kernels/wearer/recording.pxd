"""Recorded motion of both legs, repeated."""

from libc.math cimport floor

from cext.kernels.wearer.reference cimport Path

cdef enum: # of a sample (blocks/wearer/recording.py): values with their rates, then values alone
    PITCH_PATH = 6              # after hip, knee, ankle of the left and of the right leg
    HEIGHT_PATH                 # of the hips, m
    SPEED_PATH                  # of the hips, m/s
    PATHS
    PHASES = 2 * PATHS          # left and right, unwrapped, in strides
    MOMENTS = PHASES + 2        # of the joints, N·m/kg
    VERTICAL = MOMENTS + 6      # force on each foot, body weights
    FORWARD = VERTICAL + 2
    CENTRE = FORWARD + 2        # of pressure, foot lengths from the heel
    MEAN_SPEED = CENTRE + 2     # m/s
    SAMPLE

cdef struct Play:               # the recording at one instant
    Path paths[PATHS]
    double values[SAMPLE - PHASES]
    double phase_rate


cdef inline void play(const double *samples, int count, double time, Play *out) noexcept nogil:
    """Interpolate the samples at a time, paths by cubics through values and rates, other values linearly.

    samples : their rate in Hz, then SAMPLE numbers each
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
    for j in range(PATHS):
        d = next[2 * j] - now[2 * j]
        a = now[2 * j + 1] / rate
        b = next[2 * j + 1] / rate
        out.paths[j].x = now[2 * j] + x * a + x2 * (3.0 * d - 2.0 * a - b) + x2 * x * (a + b - 2.0 * d)
        out.paths[j].v = rate * (a + 2.0 * x * (3.0 * d - 2.0 * a - b) + 3.0 * x2 * (a + b - 2.0 * d))
        out.paths[j].a = rate * rate * (2.0 * (3.0 * d - 2.0 * a - b) + 6.0 * x * (a + b - 2.0 * d))
    for j in range(SAMPLE - PHASES):
        out.values[j] = now[PHASES + j] + x * (next[PHASES + j] - now[PHASES + j])
    for j in range(2):
        out.values[j] -= floor(out.values[j])
    out.phase_rate = rate * (next[PHASES] - now[PHASES])
