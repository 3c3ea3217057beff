# cython: freethreading_compatible=True
"""Limiters. A non-finite input results in NaN, on which the actuator faults; fmin and fmax would give full torque."""

from libc.math cimport NAN, fabs, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, PERIOD, export, items, kernel_t
from cext.kernels.limits cimport clip, is_finite, toward
from cext.kernels.compensated_sum cimport RUNNING, RUNNING_REST, add


cdef struct Saturation:
    int32_t u, y, lower, upper

SATURATION = items((<Saturation *>ITEMS)[0], "u[...] y[...]")


cdef int saturation_kernel(double *arena, const Saturation *at, const Saturation *sizes) noexcept nogil:
    cdef double *u = arena + at.u
    cdef double *y = arena + at.y
    cdef double low = arena[at.lower]
    cdef double high = arena[at.upper]
    cdef int i
    for i in range(sizes.y):
        y[i] = clip(u[i], low, high)
    return OK


cdef struct SlewRate:
    int32_t u, y, rate, previous

SLEW_RATE = items((<SlewRate *>ITEMS)[0], "u[...] y[...] previous[...]")


cdef int slew_kernel(double *arena, const SlewRate *at, const SlewRate *sizes) noexcept nogil:
    cdef double most = arena[at.rate] * arena[DT]
    cdef double *previous = arena + at.previous
    cdef double y
    cdef int i
    for i in range(sizes.y):
        y = toward(previous[i], arena[at.u + i], most)
        arena[at.y + i] = y
        if y == y:
            previous[i] = y
    return OK


cdef int slew_settle(double *arena, const SlewRate *at, const SlewRate *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        if is_finite(arena[at.u + i]):
            arena[at.previous + i] = arena[at.u + i]
    return OK


cdef struct TorqueLimiter:
    int32_t torque, limited, limit, slew, previous

TORQUE_LIMITER = items((<TorqueLimiter *>ITEMS)[0])


cdef int torque_limiter_kernel(double *arena, const TorqueLimiter *at, const TorqueLimiter *sizes) noexcept nogil:
    # a slew of NaN, the default, is the whole range in 0.1 s
    cdef double limit = arena[at.limit]
    cdef double slew = arena[at.slew]
    cdef double y
    if slew != slew:
        slew = 20.0 * limit
    y = toward(clip(arena[at.previous], -limit, limit), clip(arena[at.torque], -limit, limit), slew * arena[DT])
    arena[at.limited] = y
    if y == y:
        arena[at.previous] = y
    return OK


cdef int dead_zone_kernel(double *arena, const Saturation *at, const Saturation *sizes) noexcept nogil:
    cdef double u
    cdef int i
    for i in range(sizes.y):
        u = arena[at.u + i]
        arena[at.y + i] = u - clip(u, arena[at.lower], arena[at.upper])
    return OK


cdef struct PowerLimiter:
    int32_t torque, velocity, limited, power

POWER_LIMITER = items((<PowerLimiter *>ITEMS)[0], "torque[...] velocity[...] limited[...]")


cdef int power_kernel(double *arena, const PowerLimiter *at, const PowerLimiter *sizes) noexcept nogil:
    cdef double power = arena[at.power]
    cdef double torque, velocity
    cdef int i
    for i in range(sizes.limited):
        torque = arena[at.torque + i]
        velocity = arena[at.velocity + i]
        if not (is_finite(torque) and is_finite(velocity)):
            torque = NAN
        elif fabs(torque * velocity) > power:
            torque = power / fabs(velocity) if torque > 0.0 else -power / fabs(velocity)
        arena[at.limited + i] = torque
    return OK


cdef struct SoftStop:
    int32_t torque, position, velocity, stopped, lower, upper, stiffness, damping

SOFT_STOP = items((<SoftStop *>ITEMS)[0])


cdef int soft_stop_kernel(double *arena, const SoftStop *at, const SoftStop *sizes) noexcept nogil:
    cdef double torque = arena[at.torque]
    cdef double position = arena[at.position]
    cdef double velocity = arena[at.velocity]
    if not (is_finite(position) and is_finite(velocity)):
        torque = NAN
    elif position > arena[at.upper]:
        torque = torque - arena[at.stiffness] * (position - arena[at.upper])
        if velocity > 0.0:
            torque = torque - arena[at.damping] * velocity
    elif position < arena[at.lower]:
        torque = torque + arena[at.stiffness] * (arena[at.lower] - position)
        if velocity < 0.0:
            torque = torque - arena[at.damping] * velocity
    arena[at.stopped] = torque
    return OK


cdef struct Derating:
    int32_t torque, temperature, derated, full, none

DERATING = items((<Derating *>ITEMS)[0], "torque[...] derated[...]")


cdef int derating_kernel(double *arena, const Derating *at, const Derating *sizes) noexcept nogil:
    cdef double temperature = arena[at.temperature]
    cdef double full = arena[at.full]
    cdef double none = arena[at.none]
    cdef double share = NAN
    cdef int i
    if is_finite(temperature):
        share = 1.0 if temperature <= full else 0.0 if temperature >= none else (none - temperature) / (none - full)
    for i in range(sizes.derated):
        arena[at.derated + i] = share * arena[at.torque + i]
    return OK


cdef struct SoftStart:
    int32_t u, enable, y, duration, elapsed

SOFT_START = items((<SoftStart *>ITEMS)[0], "u[...] y[...]")


cdef int soft_start_kernel(double *arena, const SoftStart *at, const SoftStart *sizes) noexcept nogil:
    cdef double enable = arena[at.enable]
    cdef double *elapsed = arena + at.elapsed
    cdef double share = 0.0
    cdef int i
    if enable == 0.0:
        elapsed[0] = -1.0
    elif enable != enable:
        share = enable
    else:
        elapsed[0] = elapsed[0] + arena[DT] if elapsed[0] >= 0.0 else 0.0
        share = 1.0 if elapsed[0] >= arena[at.duration] else elapsed[0] / arena[at.duration]
    for i in range(sizes.y):
        arena[at.y + i] = share * arena[at.u + i]
    return OK


cdef struct RMSTorqueLimiter:
    int32_t torque, limited, limit, squares, sums, place, ticks

RMSTORQUE_LIMITER = items((<RMSTorqueLimiter *>ITEMS)[0], "squares[...] sums[2]")


cdef inline void remember(double *arena, const RMSTorqueLimiter *at, const RMSTorqueLimiter *sizes,
        double square) noexcept nogil:
    """Replace the oldest square by the newest; before the window is full, replace a zero."""
    cdef int place = <int>arena[at.place]
    cdef double *sums = arena + at.sums
    add(sums + RUNNING, -arena[at.squares + place])
    add(sums + RUNNING, square)
    arena[at.squares + place] = square
    arena[at.place] = 0.0 if place + 1 == sizes.squares else place + 1


cdef int rms_torque_kernel(double *arena, const RMSTorqueLimiter *at, const RMSTorqueLimiter *sizes) noexcept nogil:
    cdef int length = sizes.squares
    cdef double *sums = arena + at.sums
    cdef double limit = arena[at.limit]
    cdef double budget, most, y
    cdef int missed = <int>(min(arena[DT] / arena[PERIOD], <double>length) - 0.5)
    cdef int place
    for _ in range(missed):             # 1. The motor held the last torque during missed ticks.
        place = <int>arena[at.place]
        remember(arena, at, sizes, arena[at.squares + (place if place > 0 else length) - 1])
    place = <int>arena[at.place]    # 2. The remaining budget of the window, of which this tick may use its share.
    budget = length * limit * limit * (1.0 - 1e-12) - (sums[RUNNING] + sums[RUNNING_REST] - arena[at.squares + place])
    most = sqrt(budget / arena[at.ticks]) if budget > 0.0 else 0.0
    y = clip(arena[at.torque], -most, most)
    arena[at.limited] = y
    remember(arena, at, sizes, y * y if y == y else 0.0)
    return OK


saturation = export(<kernel_t>saturation_kernel, SATURATION)
slew = export(<kernel_t>slew_kernel, SLEW_RATE)
slew_at_rest = export(<kernel_t>slew_settle, SLEW_RATE)
torque_limiter = export(<kernel_t>torque_limiter_kernel, TORQUE_LIMITER)
dead_zone = export(<kernel_t>dead_zone_kernel, SATURATION)
power = export(<kernel_t>power_kernel, POWER_LIMITER)
soft_stop = export(<kernel_t>soft_stop_kernel, SOFT_STOP)
derating = export(<kernel_t>derating_kernel, DERATING)
soft_start = export(<kernel_t>soft_start_kernel, SOFT_START)
rms_torque = export(<kernel_t>rms_torque_kernel, RMSTORQUE_LIMITER)
