# cython: freethreading_compatible=True
"""P, PI, PD and PID: one law, of which each takes its part.

    u = kp (b r - y) + I + D        I += dt ki (r - y)        D = kd d(c r - y)/dt, filtered
"""

from libc.math cimport NAN, fabs, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, export
from cext.kernels.limits cimport clip, is_finite


cdef struct Gains:
    double kp, ki, kd, filter_time, b, c, lower, upper, tracking_time
    bint clamping


cdef inline double derivative(const Gains *gains, double w, double h, double *follower) noexcept nogil:
    """kd (w - v) / (τ + h), and v follows w; the first w is its own past."""
    cdef double slope
    if follower[0] != follower[0]:
        follower[0] = w
    slope = (w - follower[0]) / (gains.filter_time + h)
    follower[0] += h * slope
    return gains.kd * slope


cdef inline double tracking_time(const Gains *gains) noexcept nogil:
    """What is given; else √(Ti Td), or Ti without kd, of the gains as they are now; 1 s where these say nothing."""
    cdef double found = gains.tracking_time
    if found != found:
        found = 0.0 if gains.ki == 0.0 else sqrt(fabs(gains.kd / gains.ki)) if gains.kd != 0.0 else fabs(gains.kp / gains.ki)
    return found if found != 0.0 else 1.0


cdef inline double control(const Gains *gains, double r, double y, double h, double manual, double by_hand, double *integral,
                           double *follower) noexcept nogil:
    """One step of PI, or of PID where there is a follower."""
    cdef double others, before, raw, u, share
    if not (is_finite(r) and is_finite(y) and is_finite(manual)):
        return NAN                      # and leaves no trace
    others = gains.kp * (gains.b * r - y)
    if follower != NULL:
        others += derivative(gains, gains.c * r - y, h, follower)
    if manual != 0.0:                   # 1. By hand: the integral stands ready, so that the way back has no bump.
        u = clip(by_hand, gains.lower, gains.upper)
        if is_finite(u - others):
            integral[0] = u - others
        return u
    before = integral[0]                # 2. The law.
    integral[0] += h * gains.ki * (r - y)
    raw = others + integral[0]
    u = clip(raw, gains.lower, gains.upper)
    if not is_finite(raw):
        integral[0] = before            # an overflow leaves no trace
    elif u != raw and gains.clamping:   # 3. At a limit the integral waits, unless it leads away from there,
        if (raw > u) == (integral[0] > before):
            integral[0] = before
            u = clip(others + before, gains.lower, gains.upper)
    elif u != raw:                      # or is led back.
        share = h / tracking_time(gains)
        integral[0] += (share if share < 1.0 else 1.0) * (u - raw)
    return u


cdef int p_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # reference[n], measurement[n], command[n], kp
    cdef int i
    for i in range(sizes[2]):
        arena[slots[2] + i] = arena[slots[3]] * (arena[slots[0] + i] - arena[slots[1] + i])
    return OK


cdef int pd_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # reference[n], measurement[n], command[n], kp, kd, filter_time, b, c, follower[n]
    cdef Gains gains
    cdef double r, y, u
    cdef int i
    gains.kp, gains.kd, gains.filter_time = arena[slots[3]], arena[slots[4]], arena[slots[5]]
    gains.b, gains.c = arena[slots[6]], arena[slots[7]]
    for i in range(sizes[2]):
        r = arena[slots[0] + i]
        y = arena[slots[1] + i]
        u = NAN
        if is_finite(r) and is_finite(y):
            u = gains.kp * (gains.b * r - y) + derivative(&gains, gains.c * r - y, arena[DT], arena + slots[8] + i)
        arena[slots[2] + i] = u
    return OK


cdef int pi_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # reference[n], measurement[n], manual, manual_command[n], command[n], kp, ki, b, lower, upper, tracking_time,
    # clamps, integral[n]
    cdef Gains gains
    cdef int i
    gains.kp, gains.ki, gains.kd, gains.b = arena[slots[5]], arena[slots[6]], 0.0, arena[slots[7]]
    gains.lower, gains.upper = arena[slots[8]], arena[slots[9]]
    gains.tracking_time, gains.clamping = arena[slots[10]], arena[slots[11]] != 0.0
    for i in range(sizes[4]):
        arena[slots[4] + i] = control(&gains, arena[slots[0] + i], arena[slots[1] + i], arena[DT], arena[slots[2]], arena[slots[3] + i],
                                      arena + slots[12] + i, NULL)
    return OK


cdef int pid_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # reference[n], measurement[n], manual, manual_command[n], command[n], kp, ki, kd, filter_time, b, c, lower, upper,
    # tracking_time, clamps, integral[n], follower[n]
    cdef Gains gains
    cdef int i
    gains.kp, gains.ki, gains.kd, gains.filter_time = arena[slots[5]], arena[slots[6]], arena[slots[7]], arena[slots[8]]
    gains.b, gains.c = arena[slots[9]], arena[slots[10]]
    gains.lower, gains.upper = arena[slots[11]], arena[slots[12]]
    gains.tracking_time, gains.clamping = arena[slots[13]], arena[slots[14]] != 0.0
    for i in range(sizes[4]):
        arena[slots[4] + i] = control(&gains, arena[slots[0] + i], arena[slots[1] + i], arena[DT], arena[slots[2]], arena[slots[3] + i],
                                      arena + slots[15] + i, arena + slots[16] + i)
    return OK


p = export(p_kernel)
pd = export(pd_kernel)
pi = export(pi_kernel)
pid = export(pid_kernel)
