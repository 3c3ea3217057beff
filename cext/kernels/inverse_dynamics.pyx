# cython: freethreading_compatible=True
"""Inverse dynamics of a tree of links by the recursive Newton-Euler algorithm. NaN passes, by IEEE arithmetic.

Each link has a frame whose z axis is that of its joint. Vectors of a link are in its frame.
"""

from libc.math cimport cos, fabs, sin
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, Rest, each, export, items, kernel_t


cdef struct InverseDynamics:
    int32_t orientation, gravity, links, states
    Rest inputs                 # positions, velocities and accelerations of all joints
    Rest outputs                # torques and forces

INVERSE_DYNAMICS = items((<InverseDynamics *>ITEMS)[0], "orientation[4] links[...] states[...]")


cdef struct Link:               # written by blocks.inverse_dynamics, parents first
    double parent               # index of the link that carries the joint, -1 for the base
    double joint                # index of the joint among the inputs
    double slides               # 1 for a prismatic joint, 0 for a revolute one
    double reference            # position of the joint in which the frames are those of `rotation` and `place`
    double armature             # inertia of the rotor
    double mass
    double[9] rotation          # from this frame to that of the parent, row by row
    double[3] place             # origin of this frame in that of the parent
    double[3] moment            # mass times centre of mass
    double[6] inertia           # about the origin: xx, yy, zz, xy, xz, yz

cdef struct State:
    double[9] rotation          # as in Link, at the present position
    double[3] place
    double[3] rate              # angular velocity
    double[3] turning           # angular acceleration
    double[3] acceleration      # of the origin, less gravity
    double[3] force             # through the joint, on this link and all that it carries
    double[3] torque            # about the origin


cdef inline void add_cross(const double *a, const double *b, double *y) noexcept nogil:
    y[0] += a[1] * b[2] - a[2] * b[1]
    y[1] += a[2] * b[0] - a[0] * b[2]
    y[2] += a[0] * b[1] - a[1] * b[0]


cdef inline void add_swing(const double *rate, const double *turning, const double *r, double *y) noexcept nogil:
    """Add the acceleration of a point at r: turning × r + rate × (rate × r)."""
    cdef double[3] v
    v[0] = v[1] = v[2] = 0.0
    add_cross(rate, r, v)
    add_cross(rate, v, y)
    add_cross(turning, r, y)


cdef inline void inwards(const double *rotation, const double *u, double *y) noexcept nogil:
    """Write a vector of the parent in the frame of the link."""
    cdef int k
    for k in range(3):
        y[k] = rotation[k] * u[0] + rotation[3 + k] * u[1] + rotation[6 + k] * u[2]


cdef inline void times(const double *inertia, const double *u, double *y) noexcept nogil:
    y[0] = inertia[0] * u[0] + inertia[3] * u[1] + inertia[4] * u[2]
    y[1] = inertia[3] * u[0] + inertia[1] * u[1] + inertia[5] * u[2]
    y[2] = inertia[4] * u[0] + inertia[5] * u[1] + inertia[2] * u[2]


cdef inline void set_base(const double *orientation, double gravity, State *base) noexcept nogil:
    """Set the base at rest: its acceleration less gravity points up, the third row of its rotation to the world."""
    cdef double largest = fabs(orientation[0])
    cdef double w, x, y, z, scale
    cdef int k
    for k in range(1, 4):
        if not fabs(orientation[k]) <= largest:
            largest = fabs(orientation[k])
    w = orientation[0] / largest        # against overflow; NaN for a zero quaternion
    x = orientation[1] / largest
    y = orientation[2] / largest
    z = orientation[3] / largest
    scale = gravity / (w * w + x * x + y * y + z * z)
    for k in range(3):
        base.rate[k] = base.turning[k] = 0.0
    base.acceleration[0] = scale * 2.0 * (x * z - w * y)
    base.acceleration[1] = scale * 2.0 * (y * z + w * x)
    base.acceleration[2] = scale * (w * w - x * x - y * y + z * z)


cdef inline void move(
    const Link *link, const State *parent, double position, double velocity, double acceleration, State *state
) noexcept nogil:
    """Set the motion of a link, and the force and torque that this motion requires."""
    cdef double slides = link.slides
    cdef double turns = 1.0 - slides
    cdef double travel = position - link.reference
    cdef double c = cos(turns * travel)
    cdef double s = sin(turns * travel)
    cdef double[3] inner
    cdef double[3] momentum
    cdef const double *fixed
    cdef int k
    for k in range(3):
        fixed = &link.rotation[3 * k]
        state.rotation[3 * k] = c * fixed[0] + s * fixed[1]
        state.rotation[3 * k + 1] = c * fixed[1] - s * fixed[0]
        state.rotation[3 * k + 2] = fixed[2]
        state.place[k] = link.place[k] + slides * travel * fixed[2]
        inner[k] = parent.acceleration[k]
    add_swing(parent.rate, parent.turning, state.place, inner)
    inwards(state.rotation, inner, state.acceleration)
    inwards(state.rotation, parent.rate, state.rate)
    inwards(state.rotation, parent.turning, state.turning)
    # A turn about z adds (rate × z) velocity to the angular acceleration, a slide along z twice that to the linear one.
    state.turning[0] += turns * state.rate[1] * velocity
    state.turning[1] -= turns * state.rate[0] * velocity
    state.turning[2] += turns * acceleration
    state.acceleration[0] += slides * 2.0 * state.rate[1] * velocity
    state.acceleration[1] -= slides * 2.0 * state.rate[0] * velocity
    state.acceleration[2] += slides * acceleration
    state.rate[2] += turns * velocity
    for k in range(3):
        state.force[k] = link.mass * state.acceleration[k]
    add_swing(state.rate, state.turning, link.moment, state.force)
    times(link.inertia, state.turning, state.torque)
    times(link.inertia, state.rate, momentum)
    add_cross(state.rate, momentum, state.torque)
    add_cross(link.moment, state.acceleration, state.torque)


cdef inline void carry(const State *state, State *parent) noexcept nogil:
    """Add force and torque of a link to those of its parent."""
    cdef double[3] force
    cdef const double *row
    cdef int k
    for k in range(3):
        row = &state.rotation[3 * k]
        force[k] = row[0] * state.force[0] + row[1] * state.force[1] + row[2] * state.force[2]
        parent.force[k] += force[k]
        parent.torque[k] += row[0] * state.torque[0] + row[1] * state.torque[1] + row[2] * state.torque[2]
    add_cross(state.place, force, parent.torque)


cdef int inverse_dynamics_kernel(
    double *arena, const InverseDynamics *at, const InverseDynamics *sizes
) noexcept nogil:
    """Compute motions from the base outwards, then forces inwards. The first state is that of the base."""
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef const int32_t *outputs = each(at, at.outputs)
    cdef int count = at.outputs.count
    cdef const Link *link = <const Link *>(arena + at.links)
    cdef State *states = <State *>(arena + at.states)
    cdef State *state
    cdef int joint, i
    set_base(arena + at.orientation, arena[at.gravity], states)
    for i in range(count):
        joint = <int>link[i].joint
        move(
            &link[i], &states[<int>link[i].parent + 1], arena[inputs[joint]], arena[inputs[count + joint]],
            arena[inputs[2 * count + joint]], &states[i + 1])
    for i in range(count - 1, -1, -1):
        state = &states[i + 1]
        joint = <int>link[i].joint
        arena[outputs[joint]] = (
            (state.force[2] if link[i].slides == 1.0 else state.torque[2])
            + link[i].armature * arena[inputs[2 * count + joint]])
        if link[i].parent >= 0.0:
            carry(state, &states[<int>link[i].parent + 1])
    return OK


inverse_dynamics = export(<kernel_t>inverse_dynamics_kernel, INVERSE_DYNAMICS)
