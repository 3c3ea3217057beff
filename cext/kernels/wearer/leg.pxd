"""Two legs that hang from the pelvis as three rods each, with the trunk above them.

Angles of the rods are pitches; q is hip flexion, knee flexion and ankle dorsiflexion: thigh = hip, shank = hip - knee,
foot = shank + ankle, each on top of the pitch of the pelvis. A vector of three numbers of the pitches becomes one of
the joints by their sums: hip f1 + f2 + f3, knee -(f2 + f3), ankle f3.
"""

from libc.math cimport cos, sin

cdef enum: # of a body (blocks/wearer/body.py)
    THIGH_LENGTH, SHANK_LENGTH, ANKLE_HEIGHT, HEEL, FOOT_LENGTH
    THIGH_INERTIA, SHANK_INERTIA, FOOT_INERTIA     # about the proximal joint, distal segments as points at the far end
    SHANK_MOMENT                # m c of the shank with the foot at its end
    FOOT_AHEAD, FOOT_BELOW      # m times the place of the foot's centre of mass from the ankle
    THIGH_MOMENT                # m c of the thigh with the rest at its end
    TRUNK_MOMENT, TRUNK_INERTIA # of head, arms and trunk: m c, and about the hips
    WEIGHT, MASS                # of all
    SIZE                        # mass times height squared

cdef struct Direction:          # of a rod: its sine and cosine
    double s, c

cdef struct Geometry:
    Direction thigh, shank, foot

cdef struct Symmetric:          # 3 x 3
    double hh, hk, ha, kk, ka, aa

cdef struct Chain:              # change of a leg with the pitches of thigh, shank and foot, from the hip
    double wx[3]                # of the first moment of mass, kg·m
    double wz[3]
    double px[3]                # of the point of contact, m
    double pz[3]
    double z                    # height of the point of contact over the hip, m


cdef inline void pitches(double base, const double *q, double *out) noexcept nogil:
    """Compute the pitches, or their rates, of thigh, shank and foot. base : of the pelvis"""
    out[0] = base + q[0]
    out[1] = out[0] - q[1]
    out[2] = out[1] + q[2]


cdef inline void of_joints(const double *f, double *out) noexcept nogil:
    """Transform a vector of the pitches into one of the joints."""
    out[2] = f[2]
    out[1] = -(f[1] + f[2])
    out[0] = f[0] + f[1] + f[2]


cdef inline void directions(Geometry *g, double pelvis, const double *q) noexcept nogil:
    cdef double thigh = pelvis + q[0]
    cdef double shank = thigh - q[1]
    cdef double foot = shank + q[2]
    g.thigh.s, g.thigh.c = sin(thigh), cos(thigh)
    g.shank.s, g.shank.c = sin(shank), cos(shank)
    g.foot.s, g.foot.c = sin(foot), cos(foot)


cdef inline void chain(Chain *out, const double *body, const Geometry *g, double centre) noexcept nogil:
    """Compute the chain of a leg. centre : of pressure, from the ankle forward, m"""
    cdef double l1 = body[THIGH_LENGTH]
    cdef double l2 = body[SHANK_LENGTH]
    cdef double h = body[ANKLE_HEIGHT]
    out.px[0], out.pz[0] = l1 * g.thigh.c, l1 * g.thigh.s
    out.px[1], out.pz[1] = l2 * g.shank.c, l2 * g.shank.s
    out.px[2], out.pz[2] = h * g.foot.c - centre * g.foot.s, h * g.foot.s + centre * g.foot.c
    out.wx[0], out.wz[0] = body[THIGH_MOMENT] * g.thigh.c, body[THIGH_MOMENT] * g.thigh.s
    out.wx[1], out.wz[1] = body[SHANK_MOMENT] * g.shank.c, body[SHANK_MOMENT] * g.shank.s
    out.wx[2] = body[FOOT_BELOW] * g.foot.c - body[FOOT_AHEAD] * g.foot.s
    out.wz[2] = body[FOOT_BELOW] * g.foot.s + body[FOOT_AHEAD] * g.foot.c
    out.z = centre * g.foot.s - h * g.foot.c - out.px[0] - out.px[1]


cdef inline double dot(const double *a, const double *b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


cdef inline double along(const Chain *g, int i, int j) noexcept nogil:
    """Return the inertia between rod i and a rod j below it."""
    return g.px[i] * g.wx[j] + g.pz[i] * g.wz[j]


cdef inline double across(const Chain *g, int i, int j) noexcept nogil:
    """Return the torque on rod i per squared rate of a rod j below it; with the other sign that on j from i."""
    return g.pz[i] * g.wx[j] - g.px[i] * g.wz[j]


cdef inline void demand(const double *body, const Chain *g, const double *rate, const double *acceleration, double x,
        double z, double *torque, double *force) noexcept nogil:
    """Compute the torques of the pitches and the force at the hip, forward and up, that a motion demands.

    rate, acceleration : of the pitches; x, z : acceleration of the hip, that of gravity added
    The force is without the mass of the leg times the acceleration of the hip.
    """
    cdef double w[3]
    cdef int j
    for j in range(3):
        w[j] = rate[j] * rate[j]
        torque[j] = g.wx[j] * x + g.wz[j] * z
    torque[0] += (body[THIGH_INERTIA] * acceleration[0] + along(g, 0, 1) * acceleration[1]
        + along(g, 0, 2) * acceleration[2] + across(g, 0, 1) * w[1] + across(g, 0, 2) * w[2])
    torque[1] += (along(g, 0, 1) * acceleration[0] + body[SHANK_INERTIA] * acceleration[1]
        + along(g, 1, 2) * acceleration[2] - across(g, 0, 1) * w[0] + across(g, 1, 2) * w[2])
    torque[2] += (along(g, 0, 2) * acceleration[0] + along(g, 1, 2) * acceleration[1]
        + body[FOOT_INERTIA] * acceleration[2] - across(g, 0, 2) * w[0] - across(g, 1, 2) * w[1])
    force[0] = dot(g.wx, acceleration) - dot(g.wz, w)
    force[1] = dot(g.wz, acceleration) + dot(g.wx, w)


cdef inline Symmetric inertia(const double *body, const Chain *g, double x, double z, const double *more) noexcept nogil:
    """Compute the inertia of the joints of a leg.

    x, z : mass at the point of contact that moves forward, and up; more : added to the inertia of each pitch
    """
    cdef Symmetric m
    cdef double tt = body[THIGH_INERTIA] + x * g.px[0] * g.px[0] + z * g.pz[0] * g.pz[0] + more[0]
    cdef double ss = body[SHANK_INERTIA] + x * g.px[1] * g.px[1] + z * g.pz[1] * g.pz[1] + more[1]
    cdef double ff = body[FOOT_INERTIA] + x * g.px[2] * g.px[2] + z * g.pz[2] * g.pz[2] + more[2]
    cdef double ts = along(g, 0, 1) + x * g.px[0] * g.px[1] + z * g.pz[0] * g.pz[1]
    cdef double tf = along(g, 0, 2) + x * g.px[0] * g.px[2] + z * g.pz[0] * g.pz[2]
    cdef double sf = along(g, 1, 2) + x * g.px[1] * g.px[2] + z * g.pz[1] * g.pz[2]
    m.aa = ff
    m.ka = -(sf + ff)
    m.kk = ss + 2.0 * sf + ff
    m.ha = tf + sf + ff
    m.hk = -(ts + tf + ss + 2.0 * sf + ff)
    m.hh = tt + ss + ff + 2.0 * (ts + tf + sf)
    return m


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
