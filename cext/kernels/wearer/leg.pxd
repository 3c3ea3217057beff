"""Deviation of a leg from its reference motion under external torques at hip, knee and ankle.

The leg hangs from the pelvis as three rods. In stance the loaded foot is at rest and the leg moves the body's mass
instead: the share of the body weight on the foot times that mass is added at the point of contact. Angles of the rods
are pitches; q is hip flexion, knee flexion and ankle dorsiflexion: thigh = hip, shank = hip - knee, foot = shank +
ankle, each on top of the pelvis.
"""

from libc.math cimport cos, sin

cdef enum: # of a body (blocks/wearer/body.py)
    THIGH_LENGTH, SHANK_LENGTH, ANKLE_HEIGHT, HEEL, FOOT_LENGTH
    THIGH_INERTIA, SHANK_INERTIA, FOOT_INERTIA     # about the proximal joint, distal segments as points at the far end
    SHANK_MOMENT                # m c of the shank with the foot at its end
    FOOT_AHEAD, FOOT_BELOW      # m times the place of the foot's centre of mass from the ankle
    THIGH_WEIGHT                # gravity torque of the horizontal leg's thigh, with the rest at its end
    BODY_MASS, WEIGHT, MASS     # without one leg; weight and mass of all

cdef struct Direction:          # of a rod: its sine and cosine
    double s, c

cdef struct Geometry:
    Direction thigh, shank, foot

cdef struct Symmetric:          # 3 x 3
    double hh, hk, ha, kk, ka, aa


cdef inline void directions(Geometry *g, double pelvis, const double *q) noexcept nogil:
    cdef double thigh = pelvis + q[0]
    cdef double shank = thigh - q[1]
    cdef double foot = shank + q[2]
    g.thigh.s, g.thigh.c = sin(thigh), cos(thigh)
    g.shank.s, g.shank.c = sin(shank), cos(shank)
    g.foot.s, g.foot.c = sin(foot), cos(foot)


cdef inline Symmetric of_joints(double tt, double ts, double tf, double ss, double sf, double ff) noexcept nogil:
    """Transform a quadratic form of the pitches of thigh, shank and foot into one of the joint angles."""
    cdef Symmetric m
    m.aa = ff
    m.ka = -(sf + ff)
    m.kk = ss + 2.0 * sf + ff
    m.ha = tf + sf + ff
    m.hk = -(ts + tf + ss + 2.0 * sf + ff)
    m.hh = tt + ss + ff + 2.0 * (ts + tf + sf)
    return m


cdef inline void contact_arms(const double *body, const Geometry *g, double centre, double *x,
        double *z) noexcept nogil:
    """Compute the velocity of the point of contact from the hip per pitch rate of thigh, shank and foot.

    centre : from the ankle forward, m
    """
    cdef double h = body[ANKLE_HEIGHT]
    x[0], z[0] = body[THIGH_LENGTH] * g.thigh.c, body[THIGH_LENGTH] * g.thigh.s
    x[1], z[1] = body[SHANK_LENGTH] * g.shank.c, body[SHANK_LENGTH] * g.shank.s
    x[2], z[2] = h * g.foot.c - centre * g.foot.s, h * g.foot.s + centre * g.foot.c


cdef inline Symmetric inertia(const double *body, const Geometry *g, double borne, const double *x,
        const double *z) noexcept nogil:
    """Compute the inertia of the leg with `borne` kg at the point of contact."""
    cdef double fx = body[FOOT_BELOW] * g.foot.c - body[FOOT_AHEAD] * g.foot.s
    cdef double fz = body[FOOT_BELOW] * g.foot.s + body[FOOT_AHEAD] * g.foot.c
    cdef double l1 = body[THIGH_LENGTH]
    cdef double l2 = body[SHANK_LENGTH]
    return of_joints(
        body[THIGH_INERTIA] + borne * (x[0] * x[0] + z[0] * z[0]),
        body[SHANK_MOMENT] * l1 * (g.thigh.c * g.shank.c + g.thigh.s * g.shank.s)
        + borne * (x[0] * x[1] + z[0] * z[1]),
        l1 * (g.thigh.c * fx + g.thigh.s * fz) + borne * (x[0] * x[2] + z[0] * z[2]),
        body[SHANK_INERTIA] + borne * (x[1] * x[1] + z[1] * z[1]),
        l2 * (g.shank.c * fx + g.shank.s * fz) + borne * (x[1] * x[2] + z[1] * z[2]),
        body[FOOT_INERTIA] + borne * (x[2] * x[2] + z[2] * z[2]),
    )


cdef inline Symmetric gravity(const double *body, const Geometry *g, double load, double flat) noexcept nogil:
    """Compute the stiffness of gravity on the hanging leg, less with load, and of the ground under a flat foot."""
    cdef double free = 1.0 - load
    return of_joints(
        free * body[THIGH_WEIGHT] * g.thigh.c, 0.0, 0.0,
        free * 9.80665 * body[SHANK_MOMENT] * g.shank.c, 0.0,
        free * 9.80665 * (body[FOOT_BELOW] * g.foot.c - body[FOOT_AHEAD] * g.foot.s) + flat,
    )


cdef inline void solve(const Symmetric *m, double *b) noexcept nogil:
    """Solve m x = b in place, for a positive definite m."""
    cdef double l21 = m.hk / m.hh
    cdef double l31 = m.ha / m.hh
    cdef double d2 = m.kk - l21 * m.hk
    cdef double e = m.ka - l31 * m.hk
    cdef double l32 = e / d2
    cdef double d3 = m.aa - l31 * m.ha - l32 * e
    b[1] -= l21 * b[0]
    b[2] = (b[2] - l31 * b[0] - l32 * b[1]) / d3
    b[1] = b[1] / d2 - l32 * b[2]
    b[0] = b[0] / m.hh - l21 * b[1] - l31 * b[2]


cdef inline void times(const Symmetric *m, const double *x, double *y) noexcept nogil:
    y[0] = m.hh * x[0] + m.hk * x[1] + m.ha * x[2]
    y[1] = m.hk * x[0] + m.kk * x[1] + m.ka * x[2]
    y[2] = m.ha * x[0] + m.ka * x[1] + m.aa * x[2]


cdef inline void mix(Symmetric *m, const Symmetric *other, double share) noexcept nogil:
    """Replace m by share · m + (1 - share) · other."""
    m.hh = share * m.hh + (1.0 - share) * other.hh
    m.hk = share * m.hk + (1.0 - share) * other.hk
    m.ha = share * m.ha + (1.0 - share) * other.ha
    m.kk = share * m.kk + (1.0 - share) * other.kk
    m.ka = share * m.ka + (1.0 - share) * other.ka
    m.aa = share * m.aa + (1.0 - share) * other.aa
