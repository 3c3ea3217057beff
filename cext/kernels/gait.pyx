# cython: freethreading_compatible=True
"""Gait phase and assistance profiles."""

from libc.math cimport INFINITY, NAN, fabs, floor, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport is_finite


cdef struct GaitPhase:
    int32_t angle, velocity, phase, walking, stride_time, strides, uncertainty, threshold, event_phase, shortest, longest
    int32_t elapsed, armed, mean, valid, events, swing, spread

cdef double AGREEMENT = 0.25            # of the last cadence, within which a stride after a stop continues it
cdef double SWING_AGREEMENT = 0.4       # of the usual swing, within which a swing after a stop continues the walk
cdef double SPREAD_SHARE = 0.2          # of a stride, in the spread of the last strides
cdef double FIRST_SPREAD = 0.0025       # mean square phase error of the first stride after a stop
cdef double UNKNOWN = 0.28867513459481287       # standard deviation of a phase of which nothing is known

GAIT_PHASE = items((<GaitPhase *>ITEMS)[0])


cdef int gait_phase_kernel(double *arena, const GaitPhase *at, const GaitPhase *sizes) noexcept nogil:
    cdef double angle = arena[at.angle]
    cdef double velocity = arena[at.velocity]
    cdef double threshold = arena[at.threshold]
    cdef double longest = arena[at.longest]
    cdef double *elapsed = arena + at.elapsed
    cdef double *armed = arena + at.armed
    cdef double *mean = arena + at.mean
    cdef double *valid = arena + at.valid
    cdef double *events = arena + at.events
    cdef double *swing = arena + at.swing
    cdef double *spread = arena + at.spread
    cdef bint missing = not (is_finite(angle) and is_finite(velocity))
    cdef double phase
    if missing:
        angle = velocity = NAN          # crosses no threshold
    elapsed[0] += arena[DT]
    if angle < 0.5 * threshold and armed[0] == 0.0:
        # 1. The knee is extended again. The first swing after a stop continues the walk if it lasted as usual.
        armed[0] = 1.0
        if valid[0] >= 2.0:
            swing[0] += (elapsed[0] - swing[0]) / (3.0 if swing[0] > 0.0 else 1.0)
        elif swing[0] > 0.0 and valid[0] == 0.0 and fabs(elapsed[0] - swing[0]) < SWING_AGREEMENT * swing[0]:
            valid[0] = 2.0
            spread[0] = max(spread[0], FIRST_SPREAD)
    if armed[0] != 0.0 and angle > threshold and velocity > 0.0:
        # 2. The swinging knee crosses the threshold: one stride since the last crossing, if its duration is plausible.
        armed[0] = 0.0
        if elapsed[0] < arena[at.shortest] or elapsed[0] > longest:
            valid[0] = 0.0
        elif valid[0] == 0.0 and (swing[0] == 0.0 or fabs(elapsed[0] - mean[0]) > AGREEMENT * mean[0]):
            mean[0] = elapsed[0]
            valid[0] = 1.0
            swing[0] = 0.0      # of another cadence
        else:
            phase = elapsed[0] / mean[0] - 1.0
            spread[0] += SPREAD_SHARE * (min(phase * phase, UNKNOWN * UNKNOWN) - spread[0])
            mean[0] += (elapsed[0] - mean[0]) / 3.0
            valid[0] = 2.0
        events[0] += 1.0
        elapsed[0] = 0.0
    if elapsed[0] > longest or (valid[0] > 0.0 and elapsed[0] > 1.5 * mean[0]):
        # 3. The wearer has stopped: the interval from this event to the next is not a stride.
        valid[0] = 0.0
        elapsed[0] = INFINITY
    arena[at.phase] = NAN if missing else 0.0
    arena[at.uncertainty] = NAN if missing else UNKNOWN
    arena[at.walking] = 0.0
    arena[at.stride_time] = 0.0
    arena[at.strides] = events[0]
    if valid[0] >= 2.0:
        # 4. Two strides in a row define a cadence, which holds beyond a stop.
        arena[at.stride_time] = mean[0]
        if not missing:
            phase = arena[at.event_phase] + elapsed[0] / mean[0]
            arena[at.phase] = phase - floor(phase)
            arena[at.walking] = 1.0
            # An event that is overdue is late by this much at least.
            phase = max(0.0, elapsed[0] / mean[0] - 1.0)
            arena[at.uncertainty] = min(UNKNOWN, sqrt(spread[0] + phase * phase))
    return OK


cdef struct TorqueProfile:
    int32_t phase, enable, torque, scale, knots
    int32_t cubics              # four coefficients of each piece
    int32_t bounds

TORQUE_PROFILE = items((<TorqueProfile *>ITEMS)[0], "knots[...] cubics[...] bounds[2]")


cdef int torque_profile_kernel(double *arena, const TorqueProfile *at, const TorqueProfile *sizes) noexcept nogil:
    cdef double phase = arena[at.phase]
    cdef double *knots = arena + at.knots
    cdef double *c
    cdef double x, y
    cdef int n = sizes.knots - 1
    cdef int i = 0
    if not is_finite(phase) or arena[at.enable] != arena[at.enable]:
        arena[at.torque] = NAN
        return OK
    if arena[at.enable] == 0.0:
        arena[at.torque] = 0.0
        return OK
    phase -= floor(phase)
    if phase < knots[0]:
        phase += 1.0
    while i < n - 1 and phase >= knots[i + 1]:
        i += 1
    c = arena + at.cubics + 4 * i
    x = phase - knots[i]
    y = c[0] + x * (c[1] + x * (c[2] + x * c[3]))
    if y < arena[at.bounds]:
        y = arena[at.bounds]
    elif y > arena[at.bounds + 1]:
        y = arena[at.bounds + 1]
    arena[at.torque] = arena[at.scale] * y
    return OK


gait_phase = export(<kernel_t>gait_phase_kernel, GAIT_PHASE)
torque_profile = export(<kernel_t>torque_profile_kernel, TORQUE_PROFILE)
