"""Reference motion of a walking adult: series over the stride, blended between walking speeds.

A table of knots over the walking speed has ROW numbers per knot: first those with rates (enum below), then those
without. Between two knots each number is a cubic in the speed.
"""

from libc.math cimport M_PI, cos, floor, sin

cdef enum:
    HARMONICS = 12
    FORCE_SINES = 12
    CENTRE_SINES = 6

cdef enum: # of a row, numbers whose change with the speed moves the body
    FREQUENCY = 0               # strides per second
    PITCH = 1                   # of the pelvis
    ANGLE_MEANS = 2             # hip, knee, ankle
    ANGLES = 5                  # of each harmonic: cosine and sine of hip, knee, ankle
    HEIGHT = ANGLES + 6 * HARMONICS     # of the hips: mean, cosines and sines of harmonics 2, 4, 6
    AHEAD = HEIGHT + 7          # progress ahead of the mean speed: cosines and sines of harmonics 2, 4, 6
    MOVING = AHEAD + 6
    FOOT_OFF = MOVING           # numbers that only the value matters of
    MOMENT_MEANS = FOOT_OFF + 1
    MOMENTS = MOMENT_MEANS + 3
    VERTICAL = MOMENTS + 6 * HARMONICS
    FORWARD = VERTICAL + FORCE_SINES
    CENTRE = FORWARD + FORCE_SINES
    ROW = CENTRE + 2 + CENTRE_SINES

cdef struct Blend:              # a row at the present speed, and the first and second rates of its first part
    double speed, rate
    double value[ROW]
    double first[MOVING]
    double second[MOVING]

cdef struct Course:             # the schedule of the walking speed at one instant
    double speed, rate, second

cdef struct Path:               # a value with its velocity and acceleration
    double x, v, a


cdef inline void at_time(const double *schedule, int pieces, double t, Course *out) noexcept nogil:
    """Evaluate the schedule: of each piece its start, its end and six coefficients of a quintic; constant outside."""
    cdef int i = 0
    cdef const double *c
    cdef double x
    while i < pieces - 1 and t >= schedule[8 * i + 1]:
        i += 1
    c = schedule + 8 * i
    x = t - c[0]
    if x < 0.0:
        x = 0.0
    if t > c[1]:
        x = c[1] - c[0]
    c += 2
    out.speed = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
    out.rate = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])))
    out.second = 2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5]))


cdef inline void blend(const double *knots, int pieces, const double *table, const Course *course,
        Blend *out) noexcept nogil:
    """Evaluate the row at a speed. table : of each piece four coefficients of each number, power by power"""
    cdef int i = 0
    cdef int k
    cdef const double *c
    cdef double x
    cdef double v = course.rate
    cdef double w = course.second
    cdef double first
    if out.speed == course.speed and out.rate == 0.0 and v == 0.0 and w == 0.0:
        return                              # at a constant speed nothing changes
    out.speed = course.speed
    out.rate = v if v != 0.0 else w
    while i < pieces - 1 and course.speed >= knots[i + 1]:
        i += 1
    c = table + 4 * ROW * i
    x = course.speed - knots[i]
    for k in range(ROW):
        out.value[k] = c[k] + x * (c[ROW + k] + x * (c[2 * ROW + k] + x * c[3 * ROW + k]))
    for k in range(MOVING):
        first = c[ROW + k] + x * (2.0 * c[2 * ROW + k] + x * 3.0 * c[3 * ROW + k])
        out.first[k] = first * v
        out.second[k] = (2.0 * c[2 * ROW + k] + x * 6.0 * c[3 * ROW + k]) * v * v + first * w


cdef inline void joints(const Blend *b, const Path *phase, Path *left, Path *right, double *left_moments,
        double *right_moments, Path *height, Path *ahead) noexcept nogil:
    """Sum the harmonics of both legs: half a stride apart, their odd harmonics are opposite.

    left, right : of hip, knee and ankle; the moments in N·m/kg
    """
    cdef double w = 2.0 * M_PI * phase.v
    cdef double wa = 2.0 * M_PI * phase.a
    cdef double turn = 2.0 * M_PI * phase.x
    cdef double c1 = cos(turn)
    cdef double s1 = sin(turn)
    cdef double c = 1.0
    cdef double s = 0.0
    cdef double kw, kwa, sign, old
    cdef double x[3]
    cdef double v[3]
    cdef double a[3]
    cdef double m
    cdef const double *value
    cdef const double *first
    cdef const double *second
    cdef int k, j, n
    for j in range(3):
        n = ANGLE_MEANS + j
        left[j].x = right[j].x = b.value[n]
        left[j].v = right[j].v = b.first[n]
        left[j].a = right[j].a = b.second[n]
        left_moments[j] = right_moments[j] = b.value[MOMENT_MEANS + j]
    height.x, height.v, height.a = b.value[HEIGHT], b.first[HEIGHT], b.second[HEIGHT]
    ahead.x = ahead.v = ahead.a = 0.0
    for k in range(1, HARMONICS + 1):
        old = c
        c = c * c1 - s * s1
        s = s * c1 + old * s1
        kw = k * w
        kwa = k * wa
        sign = -1.0 if k & 1 else 1.0
        n = 6 * (k - 1)
        value, first, second = b.value + ANGLES + n, b.first + ANGLES + n, b.second + ANGLES + n
        for j in range(3):
            add(value[2 * j], value[2 * j + 1], first[2 * j], first[2 * j + 1], second[2 * j], second[2 * j + 1],
                c, s, kw, kwa, &x[j], &v[j], &a[j])
            left[j].x += x[j]
            left[j].v += v[j]
            left[j].a += a[j]
            right[j].x += sign * x[j]
            right[j].v += sign * v[j]
            right[j].a += sign * a[j]
        value = b.value + MOMENTS + n
        for j in range(3):
            m = value[2 * j] * c + value[2 * j + 1] * s
            left_moments[j] += m
            right_moments[j] += sign * m
        if k == 2 or k == 4 or k == 6:
            n = k // 2 - 1
            wave(b, HEIGHT + 1 + n, c, s, kw, kwa, height)
            wave(b, AHEAD + n, c, s, kw, kwa, ahead)


cdef inline void add(double a, double b, double a1, double b1, double a2, double b2, double c, double s, double w,
        double wa, double *x, double *v, double *acceleration) noexcept nogil:
    """Evaluate a(t) cos + b(t) sin, whose angle has the rate w and the acceleration wa, with its derivatives."""
    cdef double in_phase = a * c + b * s
    cdef double ahead = b * c - a * s
    x[0] = in_phase
    v[0] = w * ahead + a1 * c + b1 * s
    acceleration[0] = wa * ahead - w * w * in_phase + 2.0 * w * (b1 * c - a1 * s) + a2 * c + b2 * s


cdef inline void wave(const Blend *b, int n, double c, double s, double w, double wa, Path *out) noexcept nogil:
    """Add one harmonic of the pelvis: its cosine is number n of the row, its sine n + 3."""
    cdef double x, v, a
    add(b.value[n], b.value[n + 3], b.first[n], b.first[n + 3], b.second[n], b.second[n + 3], c, s, w, wa, &x, &v, &a)
    out.x += x
    out.v += v
    out.a += a


cdef inline void contact(const Blend *b, double phase, double *vertical, double *forward,
        double *centre) noexcept nogil:
    """Evaluate the force in body weights and its centre in foot lengths from the heel. phase : of the leg, 0 to 1"""
    cdef double stance = phase / b.value[FOOT_OFF]
    cdef double s1, two, s, before, after
    cdef int k
    vertical[0] = forward[0] = centre[0] = 0.0
    if stance >= 1.0:
        return
    s1 = sin(M_PI * stance)
    two = 2.0 * cos(M_PI * stance)
    before, s = 0.0, s1
    centre[0] = b.value[CENTRE] + b.value[CENTRE + 1] * stance
    for k in range(FORCE_SINES):
        vertical[0] += b.value[VERTICAL + k] * s
        forward[0] += b.value[FORWARD + k] * s
        if k < CENTRE_SINES:
            centre[0] += b.value[CENTRE + 2 + k] * s
        after = two * s - before
        before, s = s, after


cdef inline void ease(double x, double *value, double *first, double *second) noexcept nogil:
    """Evaluate the quintic step from 0 to 1 that starts and ends with no velocity and no acceleration, 0 <= x <= 1."""
    value[0] = x * x * x * (10.0 + x * (6.0 * x - 15.0))
    first[0] = 30.0 * x * x * (1.0 - x) * (1.0 - x)
    second[0] = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
