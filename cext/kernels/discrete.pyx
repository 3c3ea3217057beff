# cython: freethreading_compatible=True
"""Delays, integrators, derivatives."""

from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, export
from cext.kernels.limits cimport clip, is_finite


cdef int unit_delay_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, initial, held[n]
    cdef double *y = arena + slots[1]
    cdef double *held = arena + slots[3]
    cdef int i
    for i in range(sizes[1]):
        y[i] = held[i]
    return OK


cdef int unit_delay_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double *u = arena + slots[0]
    cdef double *held = arena + slots[3]
    cdef int i
    for i in range(sizes[1]):
        held[i] = u[i]
    return OK


cdef int hold_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = arena[slots[0] + i]
    return OK


cdef int delay_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], samples, initial, held[samples n], place; a ring of whole inputs
    cdef double *oldest = arena + slots[4] + <int>arena[slots[5]] * sizes[1]
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = oldest[i]
    return OK


cdef int delay_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef int place = <int>arena[slots[5]]
    cdef double *oldest = arena + slots[4] + place * sizes[1]
    cdef int i
    for i in range(sizes[1]):
        oldest[i] = arena[slots[0] + i]
    place += 1
    arena[slots[5]] = 0.0 if place * sizes[1] == sizes[4] else place
    return OK


cdef enum: # of Integrator
    U, RESTART, Y, INITIAL, LOWER, UPPER, STATE, HELD


cdef inline int integrate(double *arena, const int32_t *slots, const int32_t *sizes, double old, double new) noexcept nogil:
    """x += h (old u_before + new u), inside the limits; at a restart, the initial value."""
    cdef double h = arena[DT]
    cdef double restart = arena[slots[RESTART]]
    cdef bint again = restart == restart and restart != 0.0
    cdef double *held = arena + slots[HELD]
    cdef double x, u
    cdef int i
    for i in range(sizes[Y]):
        x = arena[slots[STATE] + i]
        if old != 0.0:
            x += h * old * held[i]
        if new != 0.0:
            u = arena[slots[U] + i]
            x += h * new * u
            held[i] = u
        x = clip(x, arena[slots[LOWER]], arena[slots[UPPER]])
        if again:
            x = arena[slots[INITIAL]]
        arena[slots[STATE] + i] = x
        arena[slots[Y] + i] = x if restart == restart else restart
    return OK


cdef int forward_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return integrate(arena, slots, sizes, 1.0, 0.0)


cdef int forward_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes[Y]):
        arena[slots[HELD] + i] = arena[slots[U] + i]
    return OK


cdef int backward_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return integrate(arena, slots, sizes, 0.0, 1.0)


cdef int trapezoidal_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return integrate(arena, slots, sizes, 0.5, 0.5)


cdef int derivative_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], time_constant, follower[n]
    cdef double h = arena[DT]
    cdef double span = arena[slots[2]] + h
    cdef double *follower = arena + slots[3]
    cdef double u, slope
    cdef int i
    for i in range(sizes[1]):
        u = arena[slots[0] + i]
        if not is_finite(u):
            arena[slots[1] + i] = u
            continue
        if follower[i] != follower[i]:
            follower[i] = u         # the first input: no slope is known yet
        slope = (u - follower[i]) / span
        follower[i] += h * slope
        arena[slots[1] + i] = slope
    return OK


unit_delay = export(unit_delay_kernel)
unit_delay_next = export(unit_delay_update)
hold = export(hold_kernel)
delay = export(delay_kernel)
delay_next = export(delay_update)
integrator_forward = export(forward_kernel)
integrator_forward_next = export(forward_update)
integrator_backward = export(backward_kernel)
integrator_trapezoidal = export(trapezoidal_kernel)
derivative = export(derivative_kernel)
