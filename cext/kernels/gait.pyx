# cython: freethreading_compatible=True
"""Gait."""

from libc.math cimport INFINITY, NAN, floor
from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, export
from cext.kernels.limits cimport is_finite


cdef int gait_phase_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # angle, velocity, phase, walking, stride_time, strides, threshold, event_phase, shortest, longest,
    # memory: elapsed, armed, mean, valid, events
    cdef double angle = arena[slots[0]]
    cdef double velocity = arena[slots[1]]
    cdef double threshold = arena[slots[6]]
    cdef double longest = arena[slots[9]]
    cdef double *elapsed = arena + slots[10]
    cdef double *armed = arena + slots[11]
    cdef double *mean = arena + slots[12]
    cdef double *valid = arena + slots[13]
    cdef double *events = arena + slots[14]
    cdef bint missing = not (is_finite(angle) and is_finite(velocity))
    cdef double phase
    if missing:
        angle = velocity = NAN          # which passes no threshold
    elapsed[0] += arena[DT]
    if angle < 0.5 * threshold:
        armed[0] = 1.0
    if armed[0] != 0.0 and angle > threshold and velocity > 0.0:
        # 1. The swing knee passes the threshold: one stride since the last time, if it is as long as a stride can be.
        armed[0] = 0.0
        if elapsed[0] >= arena[slots[8]] and elapsed[0] <= longest:
            mean[0] = elapsed[0] if valid[0] == 0.0 else mean[0] + (elapsed[0] - mean[0]) / 3.0
            valid[0] += 1.0
        else:
            valid[0] = 0.0
        events[0] += 1.0
        elapsed[0] = 0.0
    if elapsed[0] > longest or (valid[0] > 0.0 and elapsed[0] > 1.5 * mean[0]):
        # 2. The wearer has stopped: what lies between this event and the next is no stride.
        valid[0] = 0.0
        elapsed[0] = INFINITY
    arena[slots[2]] = NAN if missing else 0.0
    arena[slots[3]] = 0.0
    arena[slots[4]] = 0.0
    arena[slots[5]] = events[0]
    if valid[0] >= 2.0:
        # 3. Two strides in a row make a rhythm.
        arena[slots[4]] = mean[0]
        if not missing:
            phase = arena[slots[7]] + elapsed[0] / mean[0]
            arena[slots[2]] = phase - floor(phase)
            arena[slots[3]] = 1.0
    return OK


cdef int torque_profile_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # phase, enable, torque, scale, knots[n + 1], cubics[4 n], bounds[2]
    cdef double phase = arena[slots[0]]
    cdef double *knots = arena + slots[4]
    cdef double *c
    cdef double x, y
    cdef int n = sizes[4] - 1
    cdef int i = 0
    if not is_finite(phase) or arena[slots[1]] != arena[slots[1]]:
        arena[slots[2]] = NAN
        return OK
    if arena[slots[1]] == 0.0:
        arena[slots[2]] = 0.0
        return OK
    phase -= floor(phase)
    if phase < knots[0]:
        phase += 1.0
    while i < n - 1 and phase >= knots[i + 1]:
        i += 1
    c = arena + slots[5] + 4 * i
    x = phase - knots[i]
    y = c[0] + x * (c[1] + x * (c[2] + x * c[3]))
    if y < arena[slots[6]]:
        y = arena[slots[6]]
    elif y > arena[slots[6] + 1]:
        y = arena[slots[6] + 1]
    arena[slots[2]] = arena[slots[3]] * y
    return OK


gait_phase = export(gait_phase_kernel)
torque_profile = export(torque_profile_kernel)
