# cython: freethreading_compatible=True
"""Orientation of a body from its IMU: quaternions with w first, body to world; z is up and x is magnetic north.

Without a magnetic field, the heading starts at 0 in the direction of the body's x axis, and drifts. A rotation is
integrated about a fixed axis during a tick, and the error is computed afterwards, so that a fast rotation is not an
error. A non-finite input results in NaN and changes no state.
"""

from libc.math cimport NAN, atan2, cos, isfinite, sin, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t

cdef enum: # in `state`
    STARTED, Q, BIAS = 5, STATE = 8

cdef struct Orientation:
    int32_t gyro, accel, mag, quaternion


cdef inline double length(const double *v, int n) noexcept nogil:
    cdef double total = 0.0
    cdef int i
    for i in range(n):
        total += v[i] * v[i]
    return sqrt(total)


cdef inline bint unit(const double *v, double *u) noexcept nogil:
    """Write the unit vector of v to u. Returns False if v has no length."""
    cdef double norm = length(v, 3)
    cdef int i
    if not norm > 0.0 or not isfinite(norm):
        return False
    for i in range(3):
        u[i] = v[i] / norm
    return True


cdef inline void cross(const double *a, const double *b, double *c) noexcept nogil:
    c[0] = a[1] * b[2] - a[2] * b[1]
    c[1] = a[2] * b[0] - a[0] * b[2]
    c[2] = a[0] * b[1] - a[1] * b[0]


cdef inline void normalise(double *q) noexcept nogil:
    cdef double norm = length(q, 4)
    cdef int i
    for i in range(4):
        q[i] = q[i] / norm


cdef inline void product(const double *p, const double *q, double *y) noexcept nogil:
    y[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    y[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    y[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]


cdef inline void turn_by(double x, double y, double z, double *q) noexcept nogil:
    """Compute the quaternion of a rotation vector in rad."""
    cdef double angle = sqrt(x * x + y * y + z * z)
    cdef double share = 0.5 if angle < 1e-9 else sin(0.5 * angle) / angle
    q[0], q[1], q[2], q[3] = cos(0.5 * angle), share * x, share * y, share * z


cdef inline void integrate(double *q, const double *rate, double h) noexcept nogil:
    """Integrate an angular rate in the body's axes."""
    cdef double[4] step
    cdef double[4] before
    cdef int i
    for i in range(4):
        before[i] = q[i]
    turn_by(rate[0] * h, rate[1] * h, rate[2] * h, step)
    product(before, step, q)


cdef inline void turned(const double *q, const double *v, double *y) noexcept nogil:
    """Rotate from the body's axes to the world's."""
    cdef double[3] t
    cdef double[3] s
    cdef int i
    cross(q + 1, v, t)
    cross(q + 1, t, s)
    for i in range(3):
        y[i] = v[i] + 2.0 * (q[0] * t[i] + s[i])


cdef inline void up_of(const double *q, double *v) noexcept nogil:
    """Compute the world's z axis in the body's axes."""
    v[0] = 2.0 * (q[1] * q[3] - q[0] * q[2])
    v[1] = 2.0 * (q[0] * q[1] + q[2] * q[3])
    v[2] = 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])


cdef void from_axes(const double *north, const double *west, const double *up, double *q) noexcept nogil:
    """Compute the quaternion of the matrix whose rows are the world's axes in body coordinates. (Shepperd 1978)"""
    cdef double trace = north[0] + west[1] + up[2]
    cdef double s
    if trace > 0.0:
        s = 2.0 * sqrt(1.0 + trace)
        q[0], q[1], q[2], q[3] = 0.25 * s, (up[1] - west[2]) / s, (north[2] - up[0]) / s, (west[0] - north[1]) / s
    elif north[0] > west[1] and north[0] > up[2]:
        s = 2.0 * sqrt(1.0 + north[0] - west[1] - up[2])
        q[0], q[1], q[2], q[3] = (up[1] - west[2]) / s, 0.25 * s, (north[1] + west[0]) / s, (north[2] + up[0]) / s
    elif west[1] > up[2]:
        s = 2.0 * sqrt(1.0 + west[1] - north[0] - up[2])
        q[0], q[1], q[2], q[3] = (north[2] - up[0]) / s, (north[1] + west[0]) / s, 0.25 * s, (west[2] + up[1]) / s
    else:
        s = 2.0 * sqrt(1.0 + up[2] - north[0] - west[1])
        q[0], q[1], q[2], q[3] = (west[0] - north[1]) / s, (north[2] + up[0]) / s, (west[2] + up[1]) / s, 0.25 * s
    normalise(q)


cdef inline bint level(const double *v, const double *up, double *u) noexcept nogil:
    """Compute the direction of the part of v perpendicular to `up`. Returns False if that part is too small."""
    cdef double along = v[0] * up[0] + v[1] * up[1] + v[2] * up[2]
    cdef int i
    for i in range(3):
        u[i] = v[i] - along * up[i]
    return length(u, 3) > 1e-6 and unit(u, u)


cdef void start(double *q, const double *up, const double *field, bint has_field) noexcept nogil:
    """Compute the orientation in which a body at rest has these measurements."""
    cdef double[3] north
    cdef double[3] west
    cdef double[3] ahead
    ahead[0], ahead[1], ahead[2] = 1.0, 0.0, 0.0
    if not (has_field and level(field, up, north)) and not level(ahead, up, north):
        ahead[0], ahead[2] = 0.0, 1.0                       # x axis vertical
        level(ahead, up, north)
    cross(up, north, west)
    from_axes(north, west, up, q)


cdef bint begun(double *arena, const Orientation *at, double *state, double *up, double *field, bint *has_up,
        bint *has_field) noexcept nogil:
    """Compute the unit vectors of the measurements, and initialize on the first valid ones.

    Returns whether the state contains an orientation.
    """
    cdef const double *gyro = arena + at.gyro
    cdef const double *accel = arena + at.accel
    cdef const double *mag = arena + at.mag
    cdef double *y = arena + at.quaternion
    cdef int i
    if not isfinite(gyro[0] + gyro[1] + gyro[2] + accel[0] + accel[1] + accel[2] + mag[0] + mag[1] + mag[2]):
        for i in range(4):
            y[i] = NAN
        return False
    has_up[0] = unit(accel, up)
    has_field[0] = unit(mag, field)
    if state[STARTED] != 0.0:
        return True
    state[Q], state[Q + 1], state[Q + 2], state[Q + 3] = 1.0, 0.0, 0.0, 0.0
    if has_up[0]:
        start(state + Q, up, field, has_field[0])
        state[STARTED] = 1.0
    publish(arena, at, state)
    return False


cdef inline void publish(double *arena, const Orientation *at, const double *state) noexcept nogil:
    """Write q with its elements clamped to 1, against rounding."""
    cdef double *y = arena + at.quaternion
    cdef int i
    for i in range(4):
        y[i] = 1.0 if state[Q + i] > 1.0 else -1.0 if state[Q + i] < -1.0 else state[Q + i]


cdef inline void field_of(const double *q, const double *field, double *b) noexcept nogil:
    """Compute the field in world coordinates, north and up, from a measured one."""
    cdef double[3] h
    turned(q, field, h)
    b[0], b[1] = sqrt(h[0] * h[0] + h[1] * h[1]), h[2]


cdef struct Madgwick:
    Orientation orientation
    int32_t gain, state

MADGWICK = items((<Madgwick *>ITEMS)[0], "gyro[3] accel[3] mag[3] quaternion[4] state[8]")


cdef int madgwick_kernel(double *arena, const Madgwick *at, const Madgwick *sizes) noexcept nogil:
    """Integrate the rate, and descend the gradient of f at `gain` rad/s."""
    cdef double *state = arena + at.state
    cdef double *q = state + Q
    cdef double[3] a
    cdef double[3] m
    cdef double[3] f
    cdef double[4] s
    cdef double[2] b
    cdef bint has_up, has_field
    cdef double w, x, y, z, norm
    cdef double h = arena[DT]
    cdef int i
    if not begun(arena, &at.orientation, state, a, m, &has_up, &has_field):
        return OK
    integrate(q, arena + at.orientation.gyro, h)
    w, x, y, z = q[0], q[1], q[2], q[3]
    s[0] = s[1] = s[2] = s[3] = 0.0
    if has_up:
        up_of(q, f)
        f[0], f[1], f[2] = f[0] - a[0], f[1] - a[1], f[2] - a[2]
        s[0] = 2.0 * (x * f[1] - y * f[0])
        s[1] = 2.0 * (z * f[0] + w * f[1]) - 4.0 * x * f[2]
        s[2] = 2.0 * (z * f[1] - w * f[0]) - 4.0 * y * f[2]
        s[3] = 2.0 * (x * f[0] + y * f[1])
    if has_up and has_field:
        field_of(q, m, b)
        f[0] = 2.0 * b[0] * (0.5 - y * y - z * z) + 2.0 * b[1] * (x * z - w * y) - m[0]
        f[1] = 2.0 * b[0] * (x * y - w * z) + 2.0 * b[1] * (w * x + y * z) - m[1]
        f[2] = 2.0 * b[0] * (w * y + x * z) + 2.0 * b[1] * (0.5 - x * x - y * y) - m[2]
        s[0] += -2.0 * b[1] * y * f[0] + 2.0 * (b[1] * x - b[0] * z) * f[1] + 2.0 * b[0] * y * f[2]
        s[1] += 2.0 * b[1] * z * f[0] + 2.0 * (b[0] * y + b[1] * w) * f[1] + (2.0 * b[0] * z - 4.0 * b[1] * x) * f[2]
        s[2] += -(4.0 * b[0] * y + 2.0 * b[1] * w) * f[0] + 2.0 * (b[0] * x + b[1] * z) * f[1] + (2.0 * b[0] * w - 4.0
            * b[1] * y) * f[2]
        s[3] += (2.0 * b[1] * x - 4.0 * b[0] * z) * f[0] + 2.0 * (b[1] * y - b[0] * w) * f[1] + 2.0 * b[0] * x * f[2]
    norm = length(s, 4)
    if norm > 1e-12:
        for i in range(4):
            q[i] -= arena[at.gain] * h * s[i] / norm
    normalise(q)
    publish(arena, &at.orientation, state)
    return OK


cdef struct Mahony:
    Orientation orientation
    int32_t bias, kp, ki, state

MAHONY = items((<Mahony *>ITEMS)[0], "gyro[3] accel[3] mag[3] quaternion[4] bias[3] state[8]")


cdef int mahony_kernel(double *arena, const Mahony *at, const Mahony *sizes) noexcept nogil:
    cdef double *state = arena + at.state
    cdef double *bias = state + BIAS
    cdef const double *gyro = arena + at.orientation.gyro
    cdef double[3] a
    cdef double[3] m
    cdef double[3] expected
    cdef double[3] e
    cdef double[3] more
    cdef double[3] rate
    cdef double[2] b
    cdef bint has_up, has_field
    cdef double h = arena[DT]
    cdef int i
    if not begun(arena, &at.orientation, state, a, m, &has_up, &has_field):
        for i in range(3):
            arena[at.bias + i] = bias[i]
        return OK
    for i in range(3):
        rate[i] = gyro[i] - bias[i]
    integrate(state + Q, rate, h)
    e[0] = e[1] = e[2] = 0.0
    if has_up:
        up_of(state + Q, expected)
        cross(a, expected, e)
    if has_up and has_field:
        field_of(state + Q, m, b)
        turned_back(state + Q, b, expected)
        cross(m, expected, more)
        for i in range(3):
            e[i] += more[i]
    for i in range(3):
        bias[i] -= arena[at.ki] * e[i] * h
        rate[i] = arena[at.kp] * e[i]
        arena[at.bias + i] = bias[i]
    integrate(state + Q, rate, h)
    normalise(state + Q)
    publish(arena, &at.orientation, state)
    return OK


cdef inline void turned_back(const double *q, const double *b, double *y) noexcept nogil:
    """Compute the world's field, north and up, in the body's axes."""
    cdef double[4] back
    cdef double[3] v
    back[0], back[1], back[2], back[3] = q[0], -q[1], -q[2], -q[3]
    v[0], v[1], v[2] = b[0], 0.0, b[1]
    turned(back, v, y)


cdef struct Complementary:
    Orientation orientation
    int32_t time_constant, state

COMPLEMENTARY = items((<Complementary *>ITEMS)[0], "gyro[3] accel[3] mag[3] quaternion[4] state[8]")


cdef int complementary_kernel(double *arena, const Complementary *at, const Complementary *sizes) noexcept nogil:
    """Remove a fraction of the remaining tilt and heading errors per tick."""
    cdef double *state = arena + at.state
    cdef double *q = state + Q
    cdef double[3] a
    cdef double[3] m
    cdef double[3] v
    cdef double[4] step
    cdef double[4] before
    cdef bint has_up, has_field
    cdef double h = arena[DT]
    cdef double share = h / (arena[at.time_constant] + h)
    cdef double across, angle
    cdef int i
    if not begun(arena, &at.orientation, state, a, m, &has_up, &has_field):
        return OK
    integrate(q, arena + at.orientation.gyro, h)
    if has_up:
        turned(q, a, v)
        across = sqrt(v[0] * v[0] + v[1] * v[1])
        angle = share * atan2(across, v[2])
        if across > 1e-12:
            for i in range(4):
                before[i] = q[i]
            turn_by(angle * v[1] / across, -angle * v[0] / across, 0.0, step)
            product(step, before, q)
    if has_up and has_field:
        turned(q, m, v)
        for i in range(4):
            before[i] = q[i]
        turn_by(0.0, 0.0, -share * atan2(v[1], v[0]), step)
        product(step, before, q)
    normalise(q)
    publish(arena, &at.orientation, state)
    return OK


cdef int madgwick_settle_kernel(double *arena, const Madgwick *at, const Madgwick *sizes) noexcept nogil:
    arena[at.state + STARTED] = 0.0
    return madgwick_kernel(arena, at, sizes)


cdef int mahony_settle_kernel(double *arena, const Mahony *at, const Mahony *sizes) noexcept nogil:
    arena[at.state + STARTED] = 0.0
    return mahony_kernel(arena, at, sizes)


cdef int complementary_settle_kernel(double *arena, const Complementary *at, const Complementary *sizes) noexcept nogil:
    arena[at.state + STARTED] = 0.0
    return complementary_kernel(arena, at, sizes)


madgwick = export(<kernel_t>madgwick_kernel, MADGWICK)
madgwick_settle = export(<kernel_t>madgwick_settle_kernel, MADGWICK)
mahony, mahony_settle = export(<kernel_t>mahony_kernel, MAHONY), export(<kernel_t>mahony_settle_kernel, MAHONY)
complementary = export(<kernel_t>complementary_kernel, COMPLEMENTARY)
complementary_settle = export(<kernel_t>complementary_settle_kernel, COMPLEMENTARY)
