# cython: freethreading_compatible=True
"""Cuff between a drive and a limb, with a load cell."""

from libc.math cimport exp
from libc.stdint cimport int32_t, uint64_t

from cext.abi cimport DT, ITEMS, OK, TICK, export, items, kernel_t
from cext.kernels.philox cimport normal, philox


cdef struct Cuff:
    int32_t torque, angle, velocity, position, speed, force, measured
    int32_t lever, stiffness, relaxation, gain, zero, zero_drift, noise, seed
    int32_t state               # the enum below

CUFF = items((<Cuff *>ITEMS)[0], "state[4]")

cdef enum: # in `state`
    DEFLECTION                  # m
    RATE                        # m/s, mean over the last step
    FORCE                       # N, of the last step
    DRIFT                       # N


cdef int cuff_kernel(double *arena, const Cuff *at, const Cuff *sizes) noexcept nogil:
    cdef const double *state = arena + at.state
    cdef uint64_t[4] bits
    arena[at.position] = arena[at.angle] + state[DEFLECTION] / arena[at.lever]
    arena[at.speed] = arena[at.velocity] + state[RATE] / arena[at.lever]
    arena[at.force] = state[FORCE]
    arena[at.measured] = arena[at.gain] * state[FORCE] + arena[at.zero] + state[DRIFT]
    if arena[at.noise] != 0.0:
        philox(<uint64_t>arena[TICK], <uint64_t>arena[at.seed], bits)
        arena[at.measured] += arena[at.noise] * normal(bits[0], bits[1])
    return OK


cdef int cuff_update(double *arena, const Cuff *at, const Cuff *sizes) noexcept nogil:
    # Exact for a torque that is constant over the step: stable for any relaxation time.
    cdef double *state = arena + at.state
    cdef double dt = arena[DT]
    cdef double force = arena[at.torque] / arena[at.lever]
    cdef double share = 1.0 - exp(-dt / arena[at.relaxation])
    cdef double change = share * (force / arena[at.stiffness] - state[DEFLECTION])
    state[DEFLECTION] += change
    state[RATE] = change / dt
    state[FORCE] = force
    state[DRIFT] += arena[at.zero_drift] * dt
    return OK


cuff = export(<kernel_t>cuff_kernel, CUFF)
cuff_next = export(<kernel_t>cuff_update, CUFF)
