# cython: freethreading_compatible=True
"""Signals out of nothing but the clock."""

from libc.math cimport M_PI, cos, expm1, floor, log, sin, sqrt
from libc.stdint cimport int32_t, uint64_t

from cext.abi cimport DT, LATENESS, OK, TICK, TIME, WAKE, export
from cext.kernels.clock cimport just_after
from cext.kernels.interpolation cimport between, segment, share_of
from cext.kernels.philox cimport fraction, philox


cdef int constant_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, value
    arena[slots[0]] = arena[slots[1]]
    return OK


cdef int ramp_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, slope, time, initial, duration
    cdef double since = arena[TIME] - arena[slots[2]]
    if since < 0.0:
        since = 0.0
    if since > arena[slots[4]]:
        since = arena[slots[4]]
    arena[slots[0]] = arena[slots[3]] + arena[slots[1]] * since
    return OK


cdef int sine_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, amplitude, frequency, phase, bias
    arena[slots[0]] = arena[slots[4]] + arena[slots[1]] * sin(2.0 * M_PI * arena[slots[2]] * arena[TIME] + arena[slots[3]])
    return OK


cdef int step_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, before, after, time
    arena[slots[0]] = arena[slots[1]] if arena[TIME] < arena[slots[3]] else arena[slots[2]]
    return OK


cdef int pulse_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, low, high, period, duty, delay
    cdef double at = (just_after(arena) - arena[slots[5]]) / arena[slots[3]]
    cdef bint up = at >= 0.0 and at - floor(at) < arena[slots[4]]
    arena[slots[0]] = arena[slots[2]] if up else arena[slots[1]]
    return OK


cdef inline int sweep(double *arena, const int32_t *slots, double turns) noexcept nogil:
    # y, amplitude, start, stop, duration, phase, bias
    arena[slots[0]] = arena[slots[6]] + arena[slots[1]] * sin(2.0 * M_PI * turns + arena[slots[5]])
    return OK


cdef int chirp_linear_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double start = arena[slots[2]]
    cdef double stop = arena[slots[3]]
    cdef double duration = arena[slots[4]]
    cdef double t = arena[TIME]
    if t > duration:
        return sweep(arena, slots, 0.5 * (start + stop) * duration + stop * (t - duration))
    return sweep(arena, slots, (start + 0.5 * (stop - start) * t / duration) * t)


cdef int chirp_logarithmic_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double start = arena[slots[2]]
    cdef double stop = arena[slots[3]]
    cdef double duration = arena[slots[4]]
    cdef double growth = log(stop / start)
    cdef double t = arena[TIME]
    if growth == 0.0:
        return sweep(arena, slots, start * t)
    if t > duration:
        return sweep(arena, slots, (stop - start) * duration / growth + stop * (t - duration))
    return sweep(arena, slots, start * duration / growth * expm1(growth * t / duration))


cdef inline double in_table(double t, bint repeat, const double *times, int count) noexcept nogil:
    cdef double length = times[count - 1] - times[0]
    if repeat:
        return t - length * floor((t - times[0]) / length)
    return t


cdef int table_linear_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, repeat, times[n], values[n]
    cdef double *times = arena + slots[2]
    cdef double *values = arena + slots[3]
    cdef double t = in_table(arena[TIME], arena[slots[1]] != 0.0, times, sizes[2])
    cdef int i = segment(times, sizes[2], t)
    arena[slots[0]] = between(values[i], values[i + 1], share_of(times, i, t))
    return OK


cdef int table_previous_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, repeat, times[n], values[n]
    cdef double *times = arena + slots[2]
    cdef double t = in_table(just_after(arena), arena[slots[1]] != 0.0, times, sizes[2])
    cdef int i = segment(times, sizes[2], t)
    arena[slots[0]] = arena[slots[3] + i + (t >= times[i + 1])]
    return OK


cdef int gaussian_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, mean, deviation, seed; Box and Muller 1958
    cdef uint64_t[4] bits
    philox(<uint64_t>arena[TICK], <uint64_t>arena[slots[3]], bits)
    arena[slots[0]] = arena[slots[1]] + arena[slots[2]] * (sqrt(-2.0 * log(1.0 - fraction(bits[0]))) * cos(2.0 * M_PI * fraction(bits[1])))
    return OK


cdef int uniform_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # y, lower, upper, seed
    cdef uint64_t[4] bits
    philox(<uint64_t>arena[TICK], <uint64_t>arena[slots[3]], bits)
    arena[slots[0]] = between(arena[slots[1]], arena[slots[2]], fraction(bits[0]))
    return OK


cdef int clock_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # time, wake, lateness, elapsed
    arena[slots[0]] = arena[TIME]
    arena[slots[1]] = arena[WAKE]
    arena[slots[2]] = arena[LATENESS]
    arena[slots[3]] = arena[DT]
    return OK


clock = export(clock_kernel)
constant = export(constant_kernel)
ramp = export(ramp_kernel)
sine = export(sine_kernel)
step = export(step_kernel)
pulse = export(pulse_kernel)
chirps = {"linear": export(chirp_linear_kernel), "logarithmic": export(chirp_logarithmic_kernel)}
tables = {"linear": export(table_linear_kernel), "previous": export(table_previous_kernel)}
gaussian = export(gaussian_kernel)
uniform = export(uniform_kernel)
