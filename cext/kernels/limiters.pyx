# cython: freethreading_compatible=True
"""Limiters. NaN passes through, so that the actuator sees it and faults: fmin and fmax would turn it into full torque."""

from libc.math cimport isfinite
from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, export


cdef inline double clip(double x, double low, double high) noexcept nogil:
    if x < low:
        return low
    if x > high:
        return high
    return x                    # NaN fails both comparisons


cdef inline double toward(double previous, double target, double most) noexcept nogil:
    """From previous to target by at most `most`; never past the target, so never outside an interval that holds both."""
    cdef double change = target - previous
    if change > most:
        return previous + most
    if change < -most:
        return previous - most
    return target               # NaN too


cdef int saturation_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, lower, upper
    cdef double low = arena[slots[2]]
    cdef double high = arena[slots[3]]
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = clip(arena[slots[0] + i], low, high)
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
        if isfinite(arena[slots[0] + i]):
            arena[slots[3] + i] = arena[slots[0] + i]
    return OK


cdef int torque_limiter_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque, limited, limit, slew, previous
    cdef double limit = arena[slots[2]]
    cdef double y = toward(clip(arena[slots[4]], -limit, limit), clip(arena[slots[0]], -limit, limit), arena[slots[3]] * arena[DT])
    arena[slots[1]] = y
    if y == y:
        arena[slots[4]] = y
    return OK


saturation = export(saturation_kernel)
slew = export(slew_kernel)
slew_at_rest = export(slew_settle)
torque_limiter = export(torque_limiter_kernel)
