# cython: freethreading_compatible=True
"""Limiters. What is not finite comes out as NaN, so that the actuator sees it and faults: fmin and fmax would turn it into full torque."""

from libc.math cimport NAN, fabs, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, PERIOD, export
from cext.kernels.limits cimport clip, is_finite, toward
from cext.kernels.compensated_sum cimport RUNNING, RUNNING_REST, add


cdef int saturation_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, lower, upper
    cdef double *u = arena + slots[0]
    cdef double *y = arena + slots[1]
    cdef double low = arena[slots[2]]
    cdef double high = arena[slots[3]]
    cdef int i
    for i in range(sizes[1]):
        y[i] = clip(u[i], low, high)
    return OK


cdef int slew_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, rate, previous[n]
    cdef double most = arena[slots[2]] * arena[DT]
    cdef double *previous = arena + slots[3]
    cdef double y
    cdef int i
    for i in range(sizes[1]):
        y = toward(previous[i], arena[slots[0] + i], most)
        arena[slots[1] + i] = y
        if y == y:
            previous[i] = y
    return OK


cdef int slew_settle(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes[1]):
        if is_finite(arena[slots[0] + i]):
            arena[slots[3] + i] = arena[slots[0] + i]
    return OK


cdef int torque_limiter_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque, limited, limit, slew, previous; a slew that is not given, NaN, is the whole range in 0.1 s
    cdef double limit = arena[slots[2]]
    cdef double slew = arena[slots[3]]
    cdef double y
    if slew != slew:
        slew = 20.0 * limit
    y = toward(clip(arena[slots[4]], -limit, limit), clip(arena[slots[0]], -limit, limit), slew * arena[DT])
    arena[slots[1]] = y
    if y == y:
        arena[slots[4]] = y
    return OK


cdef int dead_zone_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], lower, upper
    cdef double u
    cdef int i
    for i in range(sizes[1]):
        u = arena[slots[0] + i]
        arena[slots[1] + i] = u - clip(u, arena[slots[2]], arena[slots[3]])
    return OK


cdef int power_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque[n], velocity[n], limited[n], power
    cdef double power = arena[slots[3]]
    cdef double torque, velocity
    cdef int i
    for i in range(sizes[2]):
        torque = arena[slots[0] + i]
        velocity = arena[slots[1] + i]
        if not (is_finite(torque) and is_finite(velocity)):
            torque = NAN
        elif fabs(torque * velocity) > power:
            torque = power / fabs(velocity) if torque > 0.0 else -power / fabs(velocity)
        arena[slots[2] + i] = torque
    return OK


cdef int soft_stop_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque, position, velocity, stopped, lower, upper, stiffness, damping
    cdef double torque = arena[slots[0]]
    cdef double position = arena[slots[1]]
    cdef double velocity = arena[slots[2]]
    if not (is_finite(position) and is_finite(velocity)):
        torque = NAN
    elif position > arena[slots[5]]:
        torque = torque - arena[slots[6]] * (position - arena[slots[5]])
        if velocity > 0.0:
            torque = torque - arena[slots[7]] * velocity
    elif position < arena[slots[4]]:
        torque = torque + arena[slots[6]] * (arena[slots[4]] - position)
        if velocity < 0.0:
            torque = torque - arena[slots[7]] * velocity
    arena[slots[3]] = torque
    return OK


cdef int derating_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque[n], temperature, derated[n], full, none
    cdef double temperature = arena[slots[1]]
    cdef double full = arena[slots[3]]
    cdef double none = arena[slots[4]]
    cdef double share = NAN
    cdef int i
    if is_finite(temperature):
        share = 1.0 if temperature <= full else 0.0 if temperature >= none else (none - temperature) / (none - full)
    for i in range(sizes[2]):
        arena[slots[2] + i] = share * arena[slots[0] + i]
    return OK


cdef int soft_start_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], enable, y[n], duration, elapsed
    cdef double enable = arena[slots[1]]
    cdef double *elapsed = arena + slots[4]
    cdef double share = 0.0
    cdef int i
    if enable == 0.0:
        elapsed[0] = -1.0
    elif enable != enable:
        share = enable
    else:
        elapsed[0] = elapsed[0] + arena[DT] if elapsed[0] >= 0.0 else 0.0
        share = 1.0 if elapsed[0] >= arena[slots[3]] else elapsed[0] / arena[slots[3]]
    for i in range(sizes[2]):
        arena[slots[2] + i] = share * arena[slots[0] + i]
    return OK


cdef enum: # of RMSTorqueLimiter
    TORQUE, LIMITED, LIMIT, WINDOW, FADE, SQUARES, SUMS, PLACE, TICKS


cdef inline void remember(double *arena, const int32_t *slots, const int32_t *sizes, double square) noexcept nogil:
    """The newest square takes the place of the oldest; before the window is full, that of a zero."""
    cdef int place = <int>arena[slots[PLACE]]
    cdef double *sums = arena + slots[SUMS]
    add(sums + RUNNING, -arena[slots[SQUARES] + place])
    add(sums + RUNNING, square)
    arena[slots[SQUARES] + place] = square
    arena[slots[PLACE]] = 0.0 if place + 1 == sizes[SQUARES] else place + 1


cdef int rms_torque_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef int length = sizes[SQUARES]
    cdef double *sums = arena + slots[SUMS]
    cdef double limit = arena[slots[LIMIT]]
    cdef double budget, most, y
    cdef int missed = <int>(min(arena[DT] / arena[PERIOD], <double>length) - 0.5)
    cdef int place
    for _ in range(missed):             # 1. Through the ticks that were missed the motor held the last torque.
        place = <int>arena[slots[PLACE]]
        remember(arena, slots, sizes, arena[slots[SQUARES] + (place if place > 0 else length) - 1])
    place = <int>arena[slots[PLACE]]    # 2. What the window still allows, of which this tick may take its share.
    budget = length * limit * limit * (1.0 - 1e-12) - (sums[RUNNING] + sums[RUNNING_REST] - arena[slots[SQUARES] + place])
    most = sqrt(budget / arena[slots[TICKS]]) if budget > 0.0 else 0.0
    y = clip(arena[slots[TORQUE]], -most, most)
    arena[slots[LIMITED]] = y
    remember(arena, slots, sizes, y * y if y == y else 0.0)
    return OK


saturation = export(saturation_kernel)
slew = export(slew_kernel)
slew_at_rest = export(slew_settle)
torque_limiter = export(torque_limiter_kernel)
dead_zone = export(dead_zone_kernel)
power = export(power_kernel)
soft_stop = export(soft_stop_kernel)
derating = export(derating_kernel)
soft_start = export(soft_start_kernel)
rms_torque = export(rms_torque_kernel)
