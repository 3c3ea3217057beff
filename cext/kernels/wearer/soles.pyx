# cython: freethreading_compatible=True
"""Force sensors under the foot of a walking adult."""

from libc.math cimport M_SQRT1_2
from libc.stdint cimport int32_t, uint64_t

from cext.abi cimport DT, ITEMS, OK, TICK, export, items, kernel_t
from cext.kernels.limits cimport clip
from cext.kernels.philox cimport fraction, normal, philox


cdef struct SoleForce:
    int32_t ground_force, centre_of_pressure, phase, force, centre, heel, forefoot
    int32_t length, heel_at, forefoot_at, forefoot_strike, gain, zero, zero_drift, noise, dropped, dropout, seed
    int32_t drift, lost

SOLE_FORCE = items((<SoleForce *>ITEMS)[0], "ground_force[2]")

cdef double STRIKE_END = 0.2    # of the stride, at which a forefoot striker has lowered the heel


cdef inline bint drops(bint lost, double share, double duration, double dt, double draw) noexcept nogil:
    """Return whether the next sample is lost: a Markov chain with the share and the mean duration of drop-outs."""
    if duration <= dt:
        return draw < share
    if lost:
        return share >= 1.0 or draw >= dt / duration
    return draw * duration * (1.0 - share) < dt * share


cdef int sole_force_kernel(double *arena, const SoleForce *at, const SoleForce *sizes) noexcept nogil:
    cdef double length = arena[at.length]
    cdef double up = arena[at.ground_force + 1]
    cdef double centre = arena[at.centre_of_pressure] / length
    cdef double early = 1.0 - arena[at.phase] / STRIKE_END
    cdef double share, zero, half
    cdef uint64_t[4] bits
    cdef uint64_t[4] others
    # 1. A forefoot striker lands in front: the centre begins there and moves to that of a heel striker.
    if early > 0.0:
        centre += arena[at.forefoot_strike] * early * early * (3.0 - 2.0 * early) * (arena[at.forefoot_at] - centre)
    # 2. Heel and forefoot bear the force so that its centre is right, as far as both can.
    share = clip((centre - arena[at.heel_at]) / (arena[at.forefoot_at] - arena[at.heel_at]), 0.0, 1.0)
    philox(2 * <uint64_t>arena[TICK], <uint64_t>arena[at.seed], bits)
    philox(2 * <uint64_t>arena[TICK] + 1, <uint64_t>arena[at.seed], others)
    arena[at.drift] += arena[at.zero_drift] * arena[DT]
    up *= arena[at.gain]
    arena[at.lost] = drops(arena[at.lost] != 0.0, arena[at.dropped], arena[at.dropout], arena[DT], fraction(others[0]))
    if arena[at.lost] != 0.0:
        up = 0.0                # reads as no force
    zero = arena[at.zero] + arena[at.drift]
    half = M_SQRT1_2 * arena[at.noise]      # half of the variance each
    arena[at.force] = up + zero + arena[at.noise] * normal(bits[0], bits[1])
    arena[at.heel] = (1.0 - share) * up + 0.5 * zero + half * normal(bits[2], bits[3])
    arena[at.forefoot] = share * up + 0.5 * zero + half * normal(others[1], others[2])
    arena[at.centre] = centre * length
    return OK


sole_force = export(<kernel_t>sole_force_kernel, SOLE_FORCE)
