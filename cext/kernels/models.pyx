# cython: freethreading_compatible=True
"""Models of limbs."""

from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t


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


limb = export(<kernel_t>limb_kernel, LIMB)
limb_next = export(<kernel_t>limb_update, LIMB)
