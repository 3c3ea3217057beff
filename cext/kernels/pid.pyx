# cython: freethreading_compatible=True
"""P, PI, PD and PID controllers: one law, of which each uses a part.

    u = kp (b r - y) + I + D        I += dt ki (r - y)        D = kd d(c r - y)/dt, filtered
"""

from libc.math cimport NAN, fabs, isinf, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport clip, is_finite, unlikely


cdef struct Gains:
    double kp, ki, kd, filter_time, b, c, lower, upper, tracking_time
    bint clamping


cdef inline double derivative(const Gains *gains, double w, double h, double *follower) noexcept nogil:
    """Return kd (w - v) / (τ + h), with v following w. The first w initializes v."""
    cdef double slope
    if unlikely(follower[0] != follower[0]):
        follower[0] = w
    slope = (w - follower[0]) / (gains.filter_time + h)
    follower[0] += h * slope
    return gains.kd * slope


cdef inline double tracking_time(const Gains *gains) noexcept nogil:
    """Return the given value; by default √(Ti Td), or Ti without kd, of the present gains; 1 s if undefined."""
    cdef double seconds = gains.tracking_time
    if seconds != seconds:
        seconds = (
            0.0 if gains.ki == 0.0 else sqrt(fabs(gains.kd / gains.ki)) if gains.kd != 0.0
            else fabs(gains.kp / gains.ki))
    return seconds if seconds != 0.0 else 1.0


cdef inline double control(const Gains *gains, double r, double y, double h, double manual, double by_hand,
    double *integral,
                           double *follower) noexcept nogil:
    """Compute one step of PI, or of PID with a follower."""
    cdef double others, before, raw, u, share
    if not (is_finite(r) and is_finite(y) and is_finite(manual)):
        return NAN                      # without a change of state
    others = gains.kp * (gains.b * r - y)
    if follower != NULL:
        others += derivative(gains, gains.c * r - y, h, follower)
    if manual != 0.0:                   # 1. Manual: the integral tracks the command, for a bumpless return.
        u = clip(by_hand, gains.lower, gains.upper)
        if is_finite(u - others):
            integral[0] = u - others
        return u
    before = integral[0]                # 2. The law.
    integral[0] += h * gains.ki * (r - y)
    raw = others + integral[0]
    u = clip(raw, gains.lower, gains.upper)
    if not is_finite(raw):
        integral[0] = before            # an overflow changes no state
    elif u != raw and gains.clamping:   # 3. At a limit: hold the integral, unless it leads away from the limit,
        if (raw > u) == (integral[0] > before):
            integral[0] = before
            u = clip(others + before, gains.lower, gains.upper)
    elif u != raw:                      # or track back.
        share = h / tracking_time(gains)
        integral[0] += (share if share < 1.0 else 1.0) * (u - raw)
    return u


cdef inline void track(
    const Gains *gains, double applied, double u, double h, double *integral, double *spoiled
) noexcept nogil:
    """Let the integral follow the command that is applied behind the controller."""
    cdef double share = h / tracking_time(gains)
    cdef double change = (share if share < 1.0 else 1.0) * (applied - u)
    spoiled[0] = applied if isinf(applied) else 0.0
    if is_finite(change):
        integral[0] += change


cdef struct PLaw:
    int32_t reference, measurement, command, kp

P_LAW = items((<PLaw *>ITEMS)[0], "reference[...] measurement[...] command[...]")


cdef int p_kernel(double *arena, const PLaw *at, const PLaw *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.command):
        arena[at.command + i] = arena[at.kp] * (arena[at.reference + i] - arena[at.measurement + i])
    return OK


cdef struct PdLaw:
    int32_t reference, measurement, command, kp, kd, filter_time, b, c, follower

PD_LAW = items((<PdLaw *>ITEMS)[0], "reference[...] measurement[...] command[...] follower[...]")


cdef int pd_kernel(double *arena, const PdLaw *at, const PdLaw *sizes) noexcept nogil:
    cdef Gains gains
    cdef double r, y, u
    cdef int i
    gains.kp, gains.kd, gains.filter_time = arena[at.kp], arena[at.kd], arena[at.filter_time]
    gains.b, gains.c = arena[at.b], arena[at.c]
    for i in range(sizes.command):
        r = arena[at.reference + i]
        y = arena[at.measurement + i]
        u = NAN
        if is_finite(r) and is_finite(y):
            u = gains.kp * (gains.b * r - y) + derivative(&gains, gains.c * r - y, arena[DT], arena + at.follower + i)
        arena[at.command + i] = u
    return OK


cdef struct PiLaw:
    int32_t reference, measurement, manual, manual_command, applied, command, kp, ki, b, lower, upper, tracking_time
    int32_t clamps, integral, spoiled

PI_LAW = items(
    (<PiLaw *>ITEMS)[0],
    "reference[...] measurement[...] manual_command[...] applied[...] command[...] integral[...] spoiled[...]")


cdef int pi_kernel(double *arena, const PiLaw *at, const PiLaw *sizes) noexcept nogil:
    cdef Gains gains
    cdef int i
    gains.kp, gains.ki, gains.kd, gains.b = arena[at.kp], arena[at.ki], 0.0, arena[at.b]
    gains.lower, gains.upper = arena[at.lower], arena[at.upper]
    gains.tracking_time, gains.clamping = arena[at.tracking_time], arena[at.clamps] != 0.0
    for i in range(sizes.command):
        arena[at.command + i] = control(
            &gains, NAN if isinf(arena[at.spoiled + i]) else arena[at.reference + i], arena[at.measurement + i],
            arena[DT], arena[at.manual], arena[at.manual_command + i],
            arena + at.integral + i, NULL)
    return OK


cdef struct PidLaw:
    int32_t reference, measurement, manual, manual_command, applied, command, kp, ki, kd, filter_time, b, c, lower
    int32_t upper, tracking_time, clamps, integral, follower, spoiled

PID_LAW = items(
    (<PidLaw *>ITEMS)[0],
    "reference[...] measurement[...] manual_command[...] applied[...] command[...] integral[...] follower[...] "
    "spoiled[...]")


cdef int pid_kernel(double *arena, const PidLaw *at, const PidLaw *sizes) noexcept nogil:
    cdef Gains gains
    cdef int i
    gains.kp, gains.ki, gains.kd, gains.filter_time = arena[at.kp], arena[at.ki], arena[at.kd], arena[at.filter_time]
    gains.b, gains.c = arena[at.b], arena[at.c]
    gains.lower, gains.upper = arena[at.lower], arena[at.upper]
    gains.tracking_time, gains.clamping = arena[at.tracking_time], arena[at.clamps] != 0.0
    for i in range(sizes.command):
        arena[at.command + i] = control(
            &gains, NAN if isinf(arena[at.spoiled + i]) else arena[at.reference + i], arena[at.measurement + i],
            arena[DT], arena[at.manual], arena[at.manual_command + i],
            arena + at.integral + i, arena + at.follower + i)
    return OK


cdef struct Tracking:
    int32_t applied, command, kp, ki, kd, tracking_time, integral, spoiled

TRACKING = items((<Tracking *>ITEMS)[0], "applied[...] command[...] integral[...] spoiled[...]")


cdef int tracking_kernel(double *arena, const Tracking *at, const Tracking *sizes) noexcept nogil:
    cdef Gains gains
    cdef int i
    gains.kp, gains.ki, gains.kd, gains.tracking_time = arena[at.kp], arena[at.ki], arena[at.kd], arena[at.tracking_time]
    for i in range(sizes.command):
        track(&gains, arena[at.applied + i], arena[at.command + i], arena[DT], arena + at.integral + i,
              arena + at.spoiled + i)
    return OK


p = export(<kernel_t>p_kernel, P_LAW)
pd = export(<kernel_t>pd_kernel, PD_LAW)
pi = export(<kernel_t>pi_kernel, PI_LAW)
pid = export(<kernel_t>pid_kernel, PID_LAW)
tracking = export(<kernel_t>tracking_kernel, TRACKING)
