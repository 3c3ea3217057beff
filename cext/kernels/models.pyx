# cython: freethreading_compatible=True
"""Models of limbs and of their motion by the wearer."""

from libc.math cimport cos, floor, sin
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, TIME, export, items, kernel_t


cdef struct Limb:
    int32_t torque, angle, rate, acceleration, position, velocity, inertia, damping, stiffness, reflex, lower
    int32_t ligament, state

LIMB = items((<Limb *>ITEMS)[0], "state[2]")


cdef int limb_kernel(double *arena, const Limb *at, const Limb *sizes) noexcept nogil:
    arena[at.position] = arena[at.state]
    arena[at.velocity] = arena[at.state + 1]
    return OK


cdef int limb_update(double *arena, const Limb *at, const Limb *sizes) noexcept nogil:
    cdef double *q = arena + at.state
    cdef double dt = arena[DT]
    cdef double wearer = arena[at.stiffness] * (arena[at.angle] - q[0]) + arena[at.reflex] * (arena[at.rate] - q[1])
    if q[0] < arena[at.lower]:
        wearer += arena[at.ligament] * (arena[at.lower] - q[0])
    q[1] += dt * ((arena[at.torque] + wearer - arena[at.damping] * (q[1] - arena[at.rate])) / arena[at.inertia]
        + arena[at.acceleration])
    q[0] += dt * q[1]           # semi-implicit Euler: the new velocity moves the joint
    return OK


cdef struct Fourier:
    int32_t angle, velocity, acceleration, stride_time, start, mean, cosines, sines

FOURIER = items((<Fourier *>ITEMS)[0], "cosines[...] sines[...]")


cdef int fourier_kernel(double *arena, const Fourier *at, const Fourier *sizes) noexcept nogil:
    cdef double base = 6.283185307179586 / arena[at.stride_time]
    cdef double x = base * arena[TIME] + 6.283185307179586 * arena[at.start]
    cdef double *a = arena + at.cosines
    cdef double *b = arena + at.sines
    cdef double angle = arena[at.mean]
    cdef double velocity = 0.0
    cdef double acceleration = 0.0
    cdef double c, s, w
    cdef int k
    for k in range(sizes.cosines):
        w = (k + 1) * base
        c = cos((k + 1) * x)
        s = sin((k + 1) * x)
        angle += a[k] * c + b[k] * s
        velocity += w * (b[k] * c - a[k] * s)
        acceleration -= w * w * (a[k] * c + b[k] * s)
    arena[at.angle] = angle
    arena[at.velocity] = velocity
    arena[at.acceleration] = acceleration
    return OK


cdef struct Playback:
    int32_t angle, velocity, acceleration, rate, angles, velocities, accelerations

PLAYBACK = items((<Playback *>ITEMS)[0], "angles[...] velocities[...] accelerations[...]")


cdef int playback_kernel(double *arena, const Playback *at, const Playback *sizes) noexcept nogil:
    """Repeat the samples, with linear interpolation."""
    cdef int n = sizes.angles - 1
    cdef double place = arena[TIME] * arena[at.rate]
    cdef double share
    cdef int i
    place -= n * floor(place / n)
    i = <int>place
    if i >= n:
        i = n - 1
    share = place - i
    arena[at.angle] = (1.0 - share) * arena[at.angles + i] + share * arena[at.angles + i + 1]
    arena[at.velocity] = (1.0 - share) * arena[at.velocities + i] + share * arena[at.velocities + i + 1]
    arena[at.acceleration] = (1.0 - share) * arena[at.accelerations + i] + share * arena[at.accelerations + i + 1]
    return OK


limb = export(<kernel_t>limb_kernel, LIMB)
limb_next = export(<kernel_t>limb_update, LIMB)
fourier = export(<kernel_t>fourier_kernel, FOURIER)
playback = export(<kernel_t>playback_kernel, PLAYBACK)
