# cython: freethreading_compatible=True
"""What a robot is attached to: limbs and the people who move them."""

from libc.math cimport cos, floor, sin
from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, TIME, export


cdef int limb_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque, angle, rate, acceleration, position, velocity, inertia, damping, stiffness, reflex, start, lower, ligament,
    # state[2]
    arena[slots[4]] = arena[slots[13]]
    arena[slots[5]] = arena[slots[13] + 1]
    return OK


cdef int limb_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double *q = arena + slots[13]
    cdef double dt = arena[DT]
    cdef double wearer = arena[slots[8]] * (arena[slots[1]] - q[0]) + arena[slots[9]] * (arena[slots[2]] - q[1])
    if q[0] < arena[slots[11]]:
        wearer += arena[slots[12]] * (arena[slots[11]] - q[0])
    q[1] += dt * ((arena[slots[0]] + wearer - arena[slots[7]] * (q[1] - arena[slots[2]])) / arena[slots[6]] + arena[slots[3]])
    q[0] += dt * q[1]           # semi-implicit Euler: the new velocity moves the joint
    return OK


cdef int fourier_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # angle, velocity, acceleration, stride_time, start, harmonics, mean, cosines[n], sines[n]
    cdef double base = 6.283185307179586 / arena[slots[3]]
    cdef double x = base * arena[TIME] + 6.283185307179586 * arena[slots[4]]
    cdef double *a = arena + slots[7]
    cdef double *b = arena + slots[8]
    cdef double angle = arena[slots[6]]
    cdef double velocity = 0.0
    cdef double acceleration = 0.0
    cdef double c, s, w
    cdef int k
    for k in range(sizes[7]):
        w = (k + 1) * base
        c = cos((k + 1) * x)
        s = sin((k + 1) * x)
        angle += a[k] * c + b[k] * s
        velocity += w * (b[k] * c - a[k] * s)
        acceleration -= w * w * (a[k] * c + b[k] * s)
    arena[slots[0]] = angle
    arena[slots[1]] = velocity
    arena[slots[2]] = acceleration
    return OK


cdef int playback_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # angle, velocity, acceleration, rate, angles[n], velocities[n], accelerations[n]; repeats, linear between samples
    cdef int n = sizes[4] - 1
    cdef double at = arena[TIME] * arena[slots[3]]
    cdef double share
    cdef int i, k
    at -= n * floor(at / n)
    i = <int>at
    if i >= n:
        i = n - 1
    share = at - i
    for k in range(3):
        arena[slots[k]] = (1.0 - share) * arena[slots[4 + k] + i] + share * arena[slots[4 + k] + i + 1]
    return OK


limb = export(limb_kernel)
limb_next = export(limb_update)
fourier = export(fourier_kernel)
playback = export(playback_kernel)
