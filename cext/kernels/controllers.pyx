# cython: freethreading_compatible=True
"""Control laws of a joint."""

from libc.math cimport sin
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport clip


cdef struct Impedance:
    int32_t position, velocity, equilibrium, torque, stiffness, damping, extra_stiffness, extra_damping

IMPEDANCE = items((<Impedance *>ITEMS)[0])


cdef int impedance_kernel(double *arena, const Impedance *at, const Impedance *sizes) noexcept nogil:
    cdef double stiffness = arena[at.stiffness] + arena[at.extra_stiffness]
    cdef double damping = arena[at.damping] + arena[at.extra_damping]
    arena[at.torque] = stiffness * (arena[at.equilibrium] - arena[at.position]) - damping * arena[at.velocity]
    return OK


cdef struct Admittance:
    int32_t torque, equilibrium, position, velocity, transition, state

ADMITTANCE = items((<Admittance *>ITEMS)[0], "transition[6] state[2]")


cdef int admittance_kernel(double *arena, const Admittance *at, const Admittance *sizes) noexcept nogil:
    arena[at.position] = arena[at.equilibrium] + arena[at.state]
    arena[at.velocity] = arena[at.state + 1]
    return OK


cdef int admittance_update(double *arena, const Admittance *at, const Admittance *sizes) noexcept nogil:
    cdef double *a = arena + at.transition
    cdef double *x = arena + at.state
    cdef double torque = arena[at.torque]
    cdef double angle = a[0] * x[0] + a[1] * x[1] + a[4] * torque
    x[1] = a[2] * x[0] + a[3] * x[1] + a[5] * torque
    x[0] = angle
    return OK


cdef struct FeedForward:
    int32_t velocity, acceleration, torque, inertia, damping, friction, slip

FEED_FORWARD = items((<FeedForward *>ITEMS)[0])


cdef int feed_forward_kernel(double *arena, const FeedForward *at, const FeedForward *sizes) noexcept nogil:
    cdef double velocity = arena[at.velocity]
    cdef double torque = arena[at.inertia] * arena[at.acceleration] + arena[at.damping] * velocity
    arena[at.torque] = torque + arena[at.friction] * clip(velocity / arena[at.slip], -1.0, 1.0)
    return OK


cdef struct Gravity:
    int32_t angle, torque, mass, length, share

GRAVITY = items((<Gravity *>ITEMS)[0])


cdef int gravity_kernel(double *arena, const Gravity *at, const Gravity *sizes) noexcept nogil:
    arena[at.torque] = arena[at.share] * arena[at.mass] * 9.80665 * arena[at.length] * sin(arena[at.angle])
    return OK


cdef struct Observer:
    int32_t torque, velocity, disturbance, inertia, damping, bandwidth, limit, filtered, started

OBSERVER = items((<Observer *>ITEMS)[0])


cdef int observer_kernel(double *arena, const Observer *at, const Observer *sizes) noexcept nogil:
    cdef double momentum = arena[at.bandwidth] * arena[at.inertia] * arena[at.velocity]
    if arena[at.started] == 0.0:
        arena[at.started], arena[at.filtered] = 1.0, momentum
    arena[at.disturbance] = clip(momentum - arena[at.filtered], -arena[at.limit], arena[at.limit])
    return OK


cdef int observer_update(double *arena, const Observer *at, const Observer *sizes) noexcept nogil:
    cdef double bandwidth = arena[at.bandwidth]
    cdef double velocity = arena[at.velocity]
    cdef double x = bandwidth * arena[at.inertia] * velocity + arena[at.torque] - arena[at.damping] * velocity
    arena[at.filtered] += min(bandwidth * arena[DT], 1.0) * (x - arena[at.filtered])
    return OK


observer = export(<kernel_t>observer_kernel, OBSERVER)
observer_next = export(<kernel_t>observer_update, OBSERVER)
impedance = export(<kernel_t>impedance_kernel, IMPEDANCE)
admittance = export(<kernel_t>admittance_kernel, ADMITTANCE)
admittance_next = export(<kernel_t>admittance_update, ADMITTANCE)
feed_forward = export(<kernel_t>feed_forward_kernel, FEED_FORWARD)
gravity = export(<kernel_t>gravity_kernel, GRAVITY)
