# cython: freethreading_compatible=True
"""Sources: signals computed from the clock."""

from libc.math cimport M_PI, cos, expm1, floor, log, sin, sqrt
from libc.stdint cimport int32_t, uint64_t

from cext.abi cimport DT, ITEMS, LATENESS, OK, TICK, TIME, WAKE, export, items, kernel_t
from cext.kernels.clock cimport just_after
from cext.kernels.interpolation cimport between, segment, share_of
from cext.kernels.philox cimport fraction, normal, philox


cdef struct Constant:
    int32_t y, value

CONSTANT = items((<Constant *>ITEMS)[0])


cdef int constant_kernel(double *arena, const Constant *at, const Constant *sizes) noexcept nogil:
    arena[at.y] = arena[at.value]
    return OK


cdef struct Ramp:
    int32_t y, slope, time, initial, duration

RAMP = items((<Ramp *>ITEMS)[0])


cdef int ramp_kernel(double *arena, const Ramp *at, const Ramp *sizes) noexcept nogil:
    cdef double since = arena[TIME] - arena[at.time]
    if since < 0.0:
        since = 0.0
    if since > arena[at.duration]:
        since = arena[at.duration]
    arena[at.y] = arena[at.initial] + arena[at.slope] * since
    return OK


cdef struct Sine:
    int32_t y, amplitude, frequency, phase, bias

SINE = items((<Sine *>ITEMS)[0])


cdef int sine_kernel(double *arena, const Sine *at, const Sine *sizes) noexcept nogil:
    arena[at.y] = arena[at.bias] + arena[at.amplitude] * sin(2.0 * M_PI * arena[at.frequency] * arena[TIME]
        + arena[at.phase])
    return OK


cdef struct Step:
    int32_t y, before, after, time

STEP = items((<Step *>ITEMS)[0])


cdef int step_kernel(double *arena, const Step *at, const Step *sizes) noexcept nogil:
    arena[at.y] = arena[at.before] if arena[TIME] < arena[at.time] else arena[at.after]
    return OK


cdef struct Pulse:
    int32_t y, low, high, period, duty, delay

PULSE = items((<Pulse *>ITEMS)[0])


cdef int pulse_kernel(double *arena, const Pulse *at, const Pulse *sizes) noexcept nogil:
    cdef double cycles = (just_after(arena) - arena[at.delay]) / arena[at.period]
    cdef bint up = cycles >= 0.0 and cycles - floor(cycles) < arena[at.duty]
    arena[at.y] = arena[at.high] if up else arena[at.low]
    return OK


cdef struct Chirp:
    int32_t y, amplitude, start, stop, duration, phase, bias

CHIRP = items((<Chirp *>ITEMS)[0])


cdef inline int sweep(double *arena, const Chirp *at, double turns) noexcept nogil:
    arena[at.y] = arena[at.bias] + arena[at.amplitude] * sin(2.0 * M_PI * turns + arena[at.phase])
    return OK


cdef int chirp_linear_kernel(double *arena, const Chirp *at, const Chirp *sizes) noexcept nogil:
    cdef double start = arena[at.start]
    cdef double stop = arena[at.stop]
    cdef double duration = arena[at.duration]
    cdef double t = arena[TIME]
    if t > duration:
        return sweep(arena, at, 0.5 * (start + stop) * duration + stop * (t - duration))
    return sweep(arena, at, (start + 0.5 * (stop - start) * t / duration) * t)


cdef int chirp_logarithmic_kernel(double *arena, const Chirp *at, const Chirp *sizes) noexcept nogil:
    cdef double start = arena[at.start]
    cdef double stop = arena[at.stop]
    cdef double duration = arena[at.duration]
    cdef double growth = log(stop / start)
    cdef double t = arena[TIME]
    if growth == 0.0:
        return sweep(arena, at, start * t)
    if t > duration:
        return sweep(arena, at, (stop - start) * duration / growth + stop * (t - duration))
    return sweep(arena, at, start * duration / growth * expm1(growth * t / duration))


cdef inline double in_table(const double *arena, double t, bint repeat, const double *times, int count) noexcept nogil:
    """Return t in s less the repetitions before the present tick, which rounding must not miscount."""
    cdef double length = times[count - 1] - times[0]
    if repeat:
        return t - length * floor((just_after(arena) - times[0]) / length)
    return t


cdef struct TimeTable:
    int32_t y, repeat, instants, samples

TIME_TABLE = items((<TimeTable *>ITEMS)[0], "instants[...] samples[...]")


cdef int table_linear_kernel(double *arena, const TimeTable *at, const TimeTable *sizes) noexcept nogil:
    cdef double *times = arena + at.instants
    cdef double *values = arena + at.samples
    cdef double t = in_table(arena, arena[TIME], arena[at.repeat] != 0.0, times, sizes.instants)
    cdef int i = segment(times, sizes.instants, t)
    arena[at.y] = between(values[i], values[i + 1], share_of(times, i, t))
    return OK


cdef int table_previous_kernel(double *arena, const TimeTable *at, const TimeTable *sizes) noexcept nogil:
    cdef double *times = arena + at.instants
    cdef double t = in_table(arena, just_after(arena), arena[at.repeat] != 0.0, times, sizes.instants)
    cdef int i = segment(times, sizes.instants, t)
    arena[at.y] = arena[at.samples + i + (t >= times[i + 1])]
    return OK


cdef struct Gaussian:
    int32_t y, mean, deviation, seed

GAUSSIAN = items((<Gaussian *>ITEMS)[0])


cdef int gaussian_kernel(double *arena, const Gaussian *at, const Gaussian *sizes) noexcept nogil:
    """Compute normally distributed noise. (Box and Muller 1958)"""
    cdef uint64_t[4] bits
    philox(<uint64_t>arena[TICK], <uint64_t>arena[at.seed], bits)
    arena[at.y] = arena[at.mean] + arena[at.deviation] * normal(bits[0], bits[1])
    return OK


cdef struct Uniform:
    int32_t y, lower, upper, seed

UNIFORM = items((<Uniform *>ITEMS)[0])


cdef int uniform_kernel(double *arena, const Uniform *at, const Uniform *sizes) noexcept nogil:
    cdef uint64_t[4] bits
    philox(<uint64_t>arena[TICK], <uint64_t>arena[at.seed], bits)
    arena[at.y] = between(arena[at.lower], arena[at.upper], fraction(bits[0]))
    return OK


cdef struct Clock:
    int32_t time, wake, lateness, elapsed

CLOCK = items((<Clock *>ITEMS)[0])


cdef int clock_kernel(double *arena, const Clock *at, const Clock *sizes) noexcept nogil:
    arena[at.time] = arena[TIME]
    arena[at.wake] = arena[WAKE]
    arena[at.lateness] = arena[LATENESS]
    arena[at.elapsed] = arena[DT]
    return OK


clock = export(<kernel_t>clock_kernel, CLOCK)
constant = export(<kernel_t>constant_kernel, CONSTANT)
ramp = export(<kernel_t>ramp_kernel, RAMP)
sine = export(<kernel_t>sine_kernel, SINE)
step = export(<kernel_t>step_kernel, STEP)
pulse = export(<kernel_t>pulse_kernel, PULSE)
chirps = {
    "linear": export(<kernel_t>chirp_linear_kernel, CHIRP),
    "logarithmic": export(<kernel_t>chirp_logarithmic_kernel, CHIRP),
}
tables = {
    "linear": export(<kernel_t>table_linear_kernel, TIME_TABLE),
    "previous": export(<kernel_t>table_previous_kernel, TIME_TABLE),
}
gaussian = export(<kernel_t>gaussian_kernel, GAUSSIAN)
uniform = export(<kernel_t>uniform_kernel, UNIFORM)
