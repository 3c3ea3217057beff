# cython: freethreading_compatible=True
"""Laws of a joint."""

from libc.math cimport sin
from libc.stdint cimport int32_t

from cext.abi cimport OK, export
from cext.kernels.limits cimport clip


cdef int impedance_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # position, velocity, equilibrium, torque, stiffness, damping
    arena[slots[3]] = arena[slots[4]] * (arena[slots[2]] - arena[slots[0]]) - arena[slots[5]] * arena[slots[1]]
    return OK


cdef int admittance_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # torque, equilibrium, position, velocity, inertia, damping, stiffness, transition[6], state[2]
    arena[slots[2]] = arena[slots[1]] + arena[slots[8]]
    arena[slots[3]] = arena[slots[8] + 1]
    return OK


cdef int admittance_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double *a = arena + slots[7]
    cdef double *x = arena + slots[8]
    cdef double torque = arena[slots[0]]
    cdef double angle = a[0] * x[0] + a[1] * x[1] + a[4] * torque
    x[1] = a[2] * x[0] + a[3] * x[1] + a[5] * torque
    x[0] = angle
    return OK


cdef int feed_forward_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # velocity, acceleration, torque, inertia, damping, friction, slip
    cdef double velocity = arena[slots[0]]
    cdef double torque = arena[slots[3]] * arena[slots[1]] + arena[slots[4]] * velocity
    arena[slots[2]] = torque + arena[slots[5]] * clip(velocity / arena[slots[6]], -1.0, 1.0)
    return OK


cdef int gravity_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # angle, torque, mass, length, share
    arena[slots[1]] = arena[slots[4]] * arena[slots[2]] * 9.80665 * arena[slots[3]] * sin(arena[slots[0]])
    return OK


impedance = export(impedance_kernel)
admittance = export(admittance_kernel)
admittance_next = export(admittance_update)
feed_forward = export(feed_forward_kernel)
gravity = export(gravity_kernel)
