# cython: freethreading_compatible=True
"""Delays, integrators, derivatives, unwrapped angles."""

from libc.math cimport NAN, floor
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport clip, is_finite


cdef struct UnitDelay:
    int32_t u, y, held

UNIT_DELAY = items((<UnitDelay *>ITEMS)[0], "u[...] y[...] held[...]")


cdef int unit_delay_kernel(double *arena, const UnitDelay *at, const UnitDelay *sizes) noexcept nogil:
    cdef double *y = arena + at.y
    cdef double *held = arena + at.held
    cdef int i
    for i in range(sizes.y):
        y[i] = held[i]
    return OK


cdef int unit_delay_update(double *arena, const UnitDelay *at, const UnitDelay *sizes) noexcept nogil:
    cdef double *u = arena + at.u
    cdef double *held = arena + at.held
    cdef int i
    for i in range(sizes.y):
        held[i] = u[i]
    return OK


cdef struct Hold:
    int32_t u, y

HOLD = items((<Hold *>ITEMS)[0], "u[...] y[...]")


cdef int hold_kernel(double *arena, const Hold *at, const Hold *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = arena[at.u + i]
    return OK


cdef struct Delay:
    int32_t u, y
    int32_t held                # ring of inputs with all their elements
    int32_t place

DELAY = items((<Delay *>ITEMS)[0], "u[...] y[...] held[...]")


cdef int delay_kernel(double *arena, const Delay *at, const Delay *sizes) noexcept nogil:
    cdef double *oldest = arena + at.held + <int>arena[at.place] * sizes.y
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = oldest[i]
    return OK


cdef int delay_update(double *arena, const Delay *at, const Delay *sizes) noexcept nogil:
    cdef int place = <int>arena[at.place]
    cdef double *oldest = arena + at.held + place * sizes.y
    cdef int i
    for i in range(sizes.y):
        oldest[i] = arena[at.u + i]
    place += 1
    arena[at.place] = 0.0 if place * sizes.y == sizes.held else place
    return OK


cdef struct Integrator:
    int32_t u, restart, y, initial, lower, upper, state, held

INTEGRATOR = items((<Integrator *>ITEMS)[0], "u[...] y[...] state[...] held[...]")


cdef inline int integrate(double *arena, const Integrator *at, const Integrator *sizes, double old,
        double new) noexcept nogil:
    """Compute x += h (old u_before + new u) within the limits; at a restart, the initial value."""
    cdef double h = arena[DT]
    cdef double restart = arena[at.restart]
    cdef bint again = restart == restart and restart != 0.0
    cdef double *held = arena + at.held
    cdef double x, u
    cdef int i
    for i in range(sizes.y):
        x = arena[at.state + i]
        if old != 0.0:
            x += h * old * held[i]
        if new != 0.0:
            u = arena[at.u + i]
            x += h * new * u
            held[i] = u
        x = clip(x, arena[at.lower], arena[at.upper])
        if again:
            x = arena[at.initial]
        arena[at.state + i] = x
        arena[at.y + i] = x if restart == restart else restart
    return OK


cdef int forward_kernel(double *arena, const Integrator *at, const Integrator *sizes) noexcept nogil:
    return integrate(arena, at, sizes, 1.0, 0.0)


cdef int forward_update(double *arena, const Integrator *at, const Integrator *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.held + i] = arena[at.u + i]
    return OK


cdef int backward_kernel(double *arena, const Integrator *at, const Integrator *sizes) noexcept nogil:
    return integrate(arena, at, sizes, 0.0, 1.0)


cdef int trapezoidal_kernel(double *arena, const Integrator *at, const Integrator *sizes) noexcept nogil:
    return integrate(arena, at, sizes, 0.5, 0.5)


cdef struct Derivative:
    int32_t u, y, time_constant, follower

DERIVATIVE = items((<Derivative *>ITEMS)[0], "u[...] y[...] follower[...]")


cdef int derivative_kernel(double *arena, const Derivative *at, const Derivative *sizes) noexcept nogil:
    cdef double h = arena[DT]
    cdef double span = arena[at.time_constant] + h
    cdef double *follower = arena + at.follower
    cdef double u, slope
    cdef int i
    for i in range(sizes.y):
        u = arena[at.u + i]
        if not is_finite(u):
            arena[at.y + i] = u
            continue
        if follower[i] != follower[i]:
            follower[i] = u         # first input: no slope yet
        slope = (u - follower[i]) / span
        follower[i] += h * slope
        arena[at.y + i] = slope
    return OK


cdef struct Unwrap:
    int32_t u, y, period, last, turns

UNWRAP = items((<Unwrap *>ITEMS)[0], "u[...] y[...] last[...] turns[...]")


cdef int unwrap_kernel(double *arena, const Unwrap *at, const Unwrap *sizes) noexcept nogil:
    cdef double period = arena[at.period]
    cdef double *last = arena + at.last
    cdef double *turns = arena + at.turns
    cdef double u
    cdef int i
    for i in range(sizes.y):
        u = arena[at.u + i]
        if not is_finite(u):
            arena[at.y + i] = NAN
            continue
        if last[i] == last[i]:          # not at the first input
            turns[i] -= floor((u - last[i]) / period + 0.5)
        last[i] = u
        arena[at.y + i] = u + period * turns[i]
    return OK


unit_delay = export(<kernel_t>unit_delay_kernel, UNIT_DELAY)
unit_delay_next = export(<kernel_t>unit_delay_update, UNIT_DELAY)
hold = export(<kernel_t>hold_kernel, HOLD)
delay = export(<kernel_t>delay_kernel, DELAY)
delay_next = export(<kernel_t>delay_update, DELAY)
integrator_forward = export(<kernel_t>forward_kernel, INTEGRATOR)
integrator_forward_next = export(<kernel_t>forward_update, INTEGRATOR)
integrator_backward = export(<kernel_t>backward_kernel, INTEGRATOR)
integrator_trapezoidal = export(<kernel_t>trapezoidal_kernel, INTEGRATOR)
derivative = export(<kernel_t>derivative_kernel, DERIVATIVE)
unwrap = export(<kernel_t>unwrap_kernel, UNWRAP)
