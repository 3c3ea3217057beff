# cython: freethreading_compatible=True
"""Iterative learning over the strides of a periodic phase, in the first harmonics of the phase."""

from libc.math cimport M_PI, NAN, cos, fabs, floor, rint, sin, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport clip, is_finite

cdef double JUMP_LIMIT = 0.1            # of the phase in a tick, and of all its steps back in a stride
cdef double DRIFT = 0.25                # share of a stride in the usual duration

cdef enum:                              # state
    PHASE                               # of the previous tick, NaN after an invalid one
    SOUND                               # 1 while the stride has been a forward one
    LEARNS                              # 1 while `learning` was true in all of the stride
    SECONDS                             # since the stride began
    BACK                                # by how much the phase has moved back
    SQUARES                             # integral of the squared error over the phase
    USUAL                               # duration of the usual stride, s
    PREVIOUS                            # duration of the previous stride, s
    STRIDES
    RMS_ERROR

cdef struct Learning:
    int32_t phase, reference, measurement, enable, learning, command, strides, rms_error
    int32_t gain, lead, forgetting, tolerance, shortest, longest, limit, curve, sums, excess, state

LEARNING = items((<Learning *>ITEMS)[0], "curve[...] sums[...] excess[...] state[10]")


cdef inline double series(const double *curve, int count, double phase) noexcept nogil:
    """Return the Fourier series at a phase. curve : mean, then cosine and sine of each harmonic"""
    cdef double c1 = cos(2.0 * M_PI * phase)
    cdef double s1 = sin(2.0 * M_PI * phase)
    cdef double c = c1
    cdef double s = s1
    cdef double total = curve[0]
    cdef double before
    cdef int k
    for k in range(1, count, 2):
        total += curve[k] * c + curve[k + 1] * s
        before = c
        c = c * c1 - s * s1
        s = s * c1 + before * s1
    return total


cdef inline void gather(double *arena, const Learning *at, int count, double error, double phase,
                        double share) noexcept nogil:
    """Add the error, and the curve beyond the limit, to the coefficients of the stride.

    share : of the stride that the phase stands for
    """
    cdef double *sums = arena + at.sums
    cdef double *excess = arena + at.excess
    cdef double beyond = series(arena + at.curve, count, phase)
    cdef double c1 = cos(2.0 * M_PI * phase)
    cdef double s1 = sin(2.0 * M_PI * phase)
    cdef double c = c1
    cdef double s = s1
    cdef double before
    cdef int k
    beyond -= clip(beyond, -arena[at.limit], arena[at.limit])
    sums[0] += share * error
    excess[0] += share * beyond
    for k in range(1, count, 2):
        sums[k] += 2.0 * share * error * c
        sums[k + 1] += 2.0 * share * error * s
        excess[k] += 2.0 * share * beyond * c
        excess[k + 1] += 2.0 * share * beyond * s
        before = c
        c = c * c1 - s * s1
        s = s * c1 + before * s1
    arena[at.state + SQUARES] += share * error * error


cdef inline void teach(double *arena, const Learning *at, int count, double seconds) noexcept nogil:
    """Update the limited curve from the error of a stride, which is advanced by `lead`, without wind-up."""
    cdef double *curve = arena + at.curve
    cdef double *sums = arena + at.sums
    cdef double *excess = arena + at.excess
    cdef double kept = 1.0 - arena[at.forgetting]
    cdef double gain = arena[at.gain]
    cdef double c1 = cos(2.0 * M_PI * arena[at.lead] / seconds)
    cdef double s1 = sin(2.0 * M_PI * arena[at.lead] / seconds)
    cdef double c = c1
    cdef double s = s1
    cdef double most, before
    cdef int k
    curve[0] = clip(kept * (curve[0] - excess[0]) + gain * sums[0], -arena[at.limit], arena[at.limit])
    for k in range(1, count, 2):
        if (k + 1) * arena[DT] > 0.999 * seconds:
            gain = 0.0                  # fewer than two ticks in a period: the error there is that of a lower harmonic
        curve[k] = kept * (curve[k] - excess[k]) + gain * (sums[k] * c + sums[k + 1] * s)
        curve[k + 1] = kept * (curve[k + 1] - excess[k + 1]) + gain * (sums[k + 1] * c - sums[k] * s)
        # 4/π: the first harmonic of a square wave between the limits. No other curve within them has a larger one.
        most = 4.0 / M_PI * arena[at.limit] / max(sqrt(curve[k] * curve[k] + curve[k + 1] * curve[k + 1]), 1e-150)
        if most < 1.0:
            curve[k] *= most
            curve[k + 1] *= most
        before = c
        c = c * c1 - s * s1
        s = s * c1 + before * s1


cdef inline void finish(double *arena, const Learning *at, int count) noexcept nogil:
    """Judge the stride that has ended, learn from it, and begin the next."""
    cdef double *state = arena + at.state
    cdef double seconds = state[SECONDS]
    cdef double tolerance = arena[at.tolerance]
    cdef int k
    # If the sum of the squares is finite, every error is below 1e155, and no coefficient overflows.
    if state[SOUND] != 0.0 and arena[at.shortest] <= seconds <= arena[at.longest] and is_finite(state[SQUARES]):
        if fabs(seconds - state[USUAL]) <= tolerance * state[USUAL]:
            state[USUAL] += DRIFT * (seconds - state[USUAL])
        elif fabs(seconds - state[PREVIOUS]) <= tolerance * state[PREVIOUS]:
            state[USUAL] = seconds      # two strides of another duration: another speed
        else:
            state[SOUND] = 0.0
        state[PREVIOUS] = seconds
        if state[SOUND] != 0.0:
            state[RMS_ERROR] = sqrt(max(state[SQUARES], 0.0))
            if state[LEARNS] != 0.0:
                teach(arena, at, count, seconds)
                state[STRIDES] += 1.0
    else:
        state[PREVIOUS] = 0.0
    state[SOUND] = state[LEARNS] = 1.0
    state[SECONDS] = state[BACK] = state[SQUARES] = 0.0
    for k in range(count):
        arena[at.sums + k] = arena[at.excess + k] = 0.0


cdef int learning_kernel(double *arena, const Learning *at, const Learning *sizes) noexcept nogil:
    cdef double *state = arena + at.state
    cdef double error = arena[at.reference] - arena[at.measurement]
    cdef double enable = arena[at.enable]
    cdef double learning = arena[at.learning]
    cdef double phase = arena[at.phase]
    cdef double last = state[PHASE]
    cdef double step, share
    cdef double y = 0.0
    phase -= floor(phase)
    if not is_finite(phase) or not is_finite(error) or enable != enable or learning != learning:
        phase = y = NAN
    if enable == 0.0 or phase != phase or last != last:
        state[SOUND] = 0.0              # until the next stride begins
    else:
        # 1. Advance by the shorter way round the circle. A stride ends where the phase passes 0 forward.
        step = phase - last
        step -= rint(step)
        if step < 0.0:
            state[BACK] -= step
        if fabs(step) > JUMP_LIMIT or state[BACK] > JUMP_LIMIT or (step < 0.0 and phase > last):
            state[SOUND] = 0.0
        share = 1.0
        if step > 0.0 and phase < last:
            share = phase / step
            state[SECONDS] += (1.0 - share) * arena[DT]
            gather(arena, at, sizes.curve, error, phase, (1.0 - share) * step)
            finish(arena, at, sizes.curve)
            if phase > JUMP_LIMIT:
                state[SOUND] = 0.0      # the jump has left out the beginning
        # 2. Gather the error of the stride.
        if learning == 0.0:
            state[LEARNS] = 0.0
        state[SECONDS] += share * arena[DT]
        gather(arena, at, sizes.curve, error, phase, share * step)
    state[PHASE] = phase
    # 3. The learned command, with the curve of the strides before.
    if y == y and enable != 0.0:
        y = clip(series(arena + at.curve, sizes.curve, phase), -arena[at.limit], arena[at.limit])
    arena[at.command], arena[at.strides], arena[at.rms_error] = y, state[STRIDES], state[RMS_ERROR]
    return OK


learning = export(<kernel_t>learning_kernel, LEARNING)
