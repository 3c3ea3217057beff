"""Anthropometry of an adult: lengths, masses and inertias of thigh, shank and foot."""

from __future__ import annotations

# Lengths in body heights. (Drillis and Contini 1966, in Winter, Biomechanics and Motor Control of Human Movement, 2009)
THIGH_LENGTH, SHANK_LENGTH, ANKLE_HEIGHT, FOOT_LENGTH = 0.245, 0.246, 0.039, 0.152

# Points of the sole along the foot from the ankle, forward, in body heights.
HEEL, BALL = -0.25 * FOOT_LENGTH, 0.47 * FOOT_LENGTH

# Mass in body masses, centre of mass from the proximal end and radius of gyration about a transverse axis in segment
# lengths; of the foot from the heel. Mean of men and women. (de Leva 1996, J Biomech 29:1223-1230)
THIGH = (0.1447, 0.3854, 0.3465)
SHANK = (0.0457, 0.4374, 0.2545)
FOOT = (0.0133, 0.4215, 0.262)

# Head, arms and trunk: centre of mass over the hips, and radius of gyration about it, in body heights. (Winter 2009)
TRUNK_CENTRE, TRUNK_GYRATION = 0.180, 0.143

GRAVITY = 9.80665  # m/s²


def plan(mass: float, height: float) -> tuple[float, ...]:
    """Return the numbers of a body in the order of the kernel's enum. mass : kg; height : m"""
    thigh, shank, foot = (length * height for length in (THIGH_LENGTH, SHANK_LENGTH, FOOT_LENGTH))
    m1, m2, m3 = (segment[0] * mass for segment in (THIGH, SHANK, FOOT))
    c1, c2 = THIGH[1] * thigh, SHANK[1] * shank
    trunk = mass - 2.0 * (m1 + m2 + m3)
    ahead, below = FOOT[1] * foot + HEEL * height, 0.5 * ANKLE_HEIGHT * height  # foot's centre of mass from the ankle
    return (
        thigh,
        shank,
        ANKLE_HEIGHT * height,
        HEEL * height,
        foot,
        m1 * (c1**2 + (THIGH[2] * thigh) ** 2) + (m2 + m3) * thigh**2,
        m2 * (c2**2 + (SHANK[2] * shank) ** 2) + m3 * shank**2,
        m3 * (ahead**2 + below**2 + (FOOT[2] * foot) ** 2),
        m2 * c2 + m3 * shank,
        m3 * ahead,
        m3 * below,
        m1 * c1 + (m2 + m3) * thigh,
        trunk * TRUNK_CENTRE * height,
        trunk * (TRUNK_CENTRE**2 + TRUNK_GYRATION**2) * height**2,
        mass * GRAVITY,
        mass,
        mass * height**2,
    )
