# cython: freethreading_compatible=True
"""Assistance torques."""

from libc.math cimport NAN, floor, sin
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport finite, is_finite

cdef enum:
    POINTS = 8

cdef double CUTOFF_TIME = 0.10243       # time constant times cut-off: two low-passes in a row have -3 dB there


cdef struct Peak:
    int32_t phase, enable, torque, peak, peak_time, rise, fall

PEAK = items((<Peak *>ITEMS)[0], "phase[...] enable[...] torque[...]")


cdef int peak_kernel(double *arena, const Peak *at, const Peak *sizes) noexcept nogil:
    cdef double phase, enable, x
    cdef int i
    for i in range(sizes.torque):
        phase = arena[at.phase + i]
        enable = arena[at.enable + i]
        if not is_finite(phase) or enable != enable:
            arena[at.torque + i] = NAN
            continue
        # 1. Before the peak, or after it, whichever is nearer in the profile; both parts are smooth cubics.
        phase -= arena[at.peak_time]
        phase -= floor(phase)
        x = 1.0 - phase / arena[at.fall]
        if x < 0.0:
            x = 1.0 - (1.0 - phase) / arena[at.rise]
        x = max(0.0, min(1.0, x))
        # 2. Just below x = 1 the cubic rounds to more than 1, which would exceed the proved peak.
        arena[at.torque + i] = arena[at.peak] * min(1.0, x * x * (3.0 - 2.0 * x)) if enable != 0.0 else 0.0
    return OK


cdef struct Spline:
    int32_t phase, enable, torque, point_0, point_1, point_2, point_3, point_4, point_5, point_6, point_7

SPLINE = items((<Spline *>ITEMS)[0], "phase[...] enable[...] torque[...]")


cdef inline double tangent(double before, double after) noexcept nogil:
    """The harmonic mean of two slopes, 0 at a peak."""
    return 2.0 * before * after / (before + after) if before * after > 0.0 else 0.0


cdef int spline_kernel(double *arena, const Spline *at, const Spline *sizes) noexcept nogil:
    cdef double p[POINTS]
    cdef double phase, enable, x, a, b, m0, m1, y
    cdef int i, k
    p[0] = arena[at.point_0]
    p[1] = arena[at.point_1]
    p[2] = arena[at.point_2]
    p[3] = arena[at.point_3]
    p[4] = arena[at.point_4]
    p[5] = arena[at.point_5]
    p[6] = arena[at.point_6]
    p[7] = arena[at.point_7]
    for i in range(sizes.torque):
        phase = arena[at.phase + i]
        enable = arena[at.enable + i]
        if not is_finite(phase) or enable != enable:
            arena[at.torque + i] = NAN
            continue
        if enable == 0.0:
            arena[at.torque + i] = 0.0
            continue
        x = POINTS * (phase - floor(phase))
        k = min(<int>x, POINTS - 1)
        x -= k
        a = p[k]
        b = p[(k + 1) % POINTS]
        m0 = tangent(a - p[(k + POINTS - 1) % POINTS], b - a)
        m1 = tangent(b - a, p[(k + 2) % POINTS] - b)
        y = a + x * (m0 + x * (3.0 * (b - a) - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * (b - a))))
        arena[at.torque + i] = max(min(a, b), min(max(a, b), y))
    return OK


cdef struct Delayed:
    int32_t delay, held, place


cdef inline double delayed(double *arena, const Delayed *at, int size, double u) noexcept nogil:
    """Store u and return its value one delay ago, interpolated; the first value before."""
    cdef double *held = arena + at.held
    cdef double *place = arena + at.place
    cdef double back = arena[at.delay] / arena[DT]
    cdef double share
    cdef int i, whole
    cdef int now = <int>place[0]
    if place[1] < size:
        place[1] += 1.0
    held[now] = u
    back = max(0.0, min(back, place[1] - 1.0))
    whole = <int>back
    share = back - whole
    i = (now - whole + size) % size
    u = held[i]
    if share > 0.0:
        u = (1.0 - share) * u + share * held[(i - 1 + size) % size]
    place[0] = (now + 1) % size
    return u


cdef inline double smoothed(double *state, double time, double dt, double u) noexcept nogil:
    """Two first-order low-passes in a row: no overshoot."""
    cdef double share = dt / (time + dt)
    if not is_finite(u):
        return finite(u)
    state[0] += share * (u - state[0])
    state[1] += share * (state[0] - state[1])
    return state[1]


cdef struct Biological:
    Delayed line
    int32_t moment, torque, scale, cutoff
    int32_t low_pass

BIOLOGICAL = items((<Biological *>ITEMS)[0], "held[...] place[2] low_pass[2]")


cdef int biological_kernel(double *arena, const Biological *at, const Biological *sizes) noexcept nogil:
    cdef double moment = arena[at.moment]
    if not is_finite(moment):
        arena[at.torque] = NAN
        return OK
    moment = delayed(arena, &at.line, sizes.line.held, moment)
    arena[at.torque] = arena[at.scale] * smoothed(arena + at.low_pass, CUTOFF_TIME / arena[at.cutoff], arena[DT], moment)
    return OK


cdef struct Feedback:
    Delayed line
    int32_t left_angle, right_angle, left_torque, right_torque, gain, cutoff
    int32_t low_pass

FEEDBACK = items((<Feedback *>ITEMS)[0], "held[...] place[2] low_pass[2]")


cdef int feedback_kernel(double *arena, const Feedback *at, const Feedback *sizes) noexcept nogil:
    cdef double y = sin(arena[at.left_angle]) - sin(arena[at.right_angle])
    if not is_finite(y):
        arena[at.left_torque] = arena[at.right_torque] = NAN
        return OK
    y = smoothed(arena + at.low_pass, CUTOFF_TIME / arena[at.cutoff], arena[DT], y)
    y = delayed(arena, &at.line, sizes.line.held, y)
    arena[at.right_torque] = arena[at.gain] * y
    arena[at.left_torque] = -arena[at.right_torque]
    return OK


cdef struct StanceSwing:
    int32_t phase, enable, position, velocity, torque
    int32_t stiffness, equilibrium, stance_damping, swing_damping, toe_off, transition
    int32_t share               # of stance, 0 to 1

STANCE_SWING = items((<StanceSwing *>ITEMS)[0])


cdef int stance_swing_kernel(double *arena, const StanceSwing *at, const StanceSwing *sizes) noexcept nogil:
    cdef double phase = arena[at.phase]
    cdef double position = arena[at.position]
    cdef double velocity = arena[at.velocity]
    cdef double *share = arena + at.share
    cdef double step = arena[DT] / arena[at.transition]
    cdef double stance, swing
    if not is_finite(phase + position + velocity) or arena[at.enable] != arena[at.enable]:
        arena[at.torque] = NAN
        return OK
    phase -= floor(phase)
    if phase < arena[at.toe_off]:
        share[0] = min(1.0, share[0] + step)
    else:
        share[0] = max(0.0, share[0] - step)
    stance = arena[at.stiffness] * (arena[at.equilibrium] - position) - arena[at.stance_damping] * velocity
    swing = -arena[at.swing_damping] * velocity
    arena[at.torque] = share[0] * stance + (1.0 - share[0]) * swing if arena[at.enable] != 0.0 else 0.0
    return OK


peak_profile = export(<kernel_t>peak_kernel, PEAK)
spline_profile = export(<kernel_t>spline_kernel, SPLINE)
biological_torque = export(<kernel_t>biological_kernel, BIOLOGICAL)
delayed_feedback = export(<kernel_t>feedback_kernel, FEEDBACK)
stance_swing = export(<kernel_t>stance_swing_kernel, STANCE_SWING)
