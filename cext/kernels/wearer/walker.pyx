# cython: freethreading_compatible=True
"""Walking adult: reference motion, deviation under assistance, muscles, ground forces."""

from libc.math cimport fabs, floor
from libc.stdint cimport int32_t, uint64_t
from libc.string cimport memmove

from cext.abi cimport DT, ITEMS, OK, TIME, Rest, each, export, items, kernel_t
from cext.kernels.limits cimport clip
from cext.kernels.wearer.leg cimport (
    BODY_MASS, FOOT_LENGTH, HEEL, MASS, SHANK_LENGTH, THIGH_LENGTH, WEIGHT, Direction, Geometry, Symmetric,
    contact_arms, directions, gravity, inertia, mix, solve, times,
)
from cext.kernels.wearer.recording cimport (
    CENTRE, FORWARD, HEIGHT_PATH, MEAN_SPEED, MOMENTS, PHASES, PITCH_PATH, SAMPLE, SPEED_PATH, VERTICAL, Play, play,
)
from cext.kernels.wearer.reference cimport (
    FREQUENCY, PITCH, Blend, Course, Path, at_time, blend, contact, ease, joints,
)
from cext.kernels.wearer.strides cimport STRIDE_TIME, VALUES, Draws, follow

cdef enum: # outputs of a leg, in the order of the class; of each joint 5
    ANGLE, VELOCITY, ACCELERATION, TORQUE, POWER
    PITCHES = 15
    MOTIONS = 18
    GROUND_FORCE = 21
    CENTRE_OF_PRESSURE, CONTACT, PHASE
    OF_LEG

cdef enum: # outputs behind those of both legs
    PELVIS_MOTION = 2 * OF_LEG
    WALKING_SPEED, PLAUSIBLE, LIMIT, PLAUSIBLE_TIME

cdef enum: # limits of people, in the order of `limits` in the class
    NONE, HIP_STOP, KNEE_STOP, ANKLE_STOP

cdef struct Muscle:             # of a joint: `muscles` in the class
    double stiffness            # without a moment, N·m/rad
    double per_moment           # more of it per N·m of moment, 1/rad
    double damping              # N·m·s/rad
    double per_stiffness        # more of it per stiffness, s
    double reflex_stiffness, reflex_damping
    double lower, upper         # range of the joint, rad

cdef struct Variation:          # standard deviations from stride to stride: `variation` in the class
    double seed
    double gain[3]              # of the angle about its mean, 1
    double offset[3]            # rad
    double stride_time          # 1

cdef struct Leg:                # of a leg, what the update needs from the step
    double angle[3]             # of the reference
    double stiffness[3]
    double damping[3]
    double reflex[3]            # torque of the delayed muscles
    double load                 # share of the body weight
    double flat                 # stiffness of the ground under a flat foot, N·m/rad
    double centre               # of pressure, from the ankle, m
    double deviation[3]
    double velocity[3]
    double acceleration[3]
    double yielded[3]           # torque that the muscles leave to the robot, N·m
    double former_load          # at the step before
    Symmetric former            # inertia at the step before

cdef struct LegReference:            # reference of a leg
    double phase
    Path q[3]                   # hip, knee, ankle
    double moments[3]           # N·m/kg
    double vertical, forward    # force of the ground, body weights
    double centre               # of pressure from the heel, foot lengths

cdef struct Reference:          # motion that the robot has not changed
    LegReference legs[2]
    double motion[9]            # of the pelvis
    double walking_speed        # m/s

cdef struct State:
    double phase                # of the left leg, in strides since the start
    double distance             # m
    double head                 # oldest entry of `history`
    double phase_rate, phase_acceleration, speed, speed_rate
    double limit                # that was exceeded first
    double plausible_time       # s until then
    Draws draws[2]
    Leg legs[2]
    Blend blend

cdef struct Walker:
    int32_t body, muscles, variation, pieces, knots, table, samples, history, state
    int32_t adaptation
    Rest inputs                 # assistance: left hip, knee, ankle, right hip, knee, ankle
    Rest outputs

WALKER = items((<Walker *>ITEMS)[0], "body[...] muscles[...] variation[...] pieces[...] knots[...] table[...] "
    "samples[...] history[...] state[...]")

cdef double FLAT_STIFFNESS = 600.0  # N·m/rad of the ground under the flat foot that bears the body weight
cdef double FLAT_RANGE = 0.1    # rad, pitch of a foot that still touches with heel and ball
cdef double CONTACT_LOAD = 0.03 # body weights, least load of a foot in contact
cdef double SHUFFLE = 0.25      # m/s, speed below which both feet keep their load
cdef double HALT = 0.15         # m/s, speed below which the stride slows down to a stand
cdef double ADAPTATION_TIME = 0.05      # s
cdef double RANGE_STIFFNESS = 800.0     # N·m/rad outside the range of a joint
cdef double RANGE_DAMPING = 20.0        # N·m·s/rad
cdef double RANGE_MARGIN = 0.0873       # rad beyond the range that ligaments bear


cdef int walker_kernel(double *arena, const Walker *at, const Walker *sizes) noexcept nogil:
    cdef State *state = <State *>(arena + at.state)
    cdef const int32_t *out = each(at, at.outputs)
    cdef Reference reference
    cdef int side
    if sizes.samples > SAMPLE:
        of_recording(arena + at.samples, sizes.samples // SAMPLE, arena[TIME], state, &reference)
    else:
        of_tables(arena, at, sizes, state, &reference)
    memmove(arena + out[PELVIS_MOTION], reference.motion, sizeof(reference.motion))
    arena[out[WALKING_SPEED]] = reference.walking_speed
    arena[out[PLAUSIBLE]] = state.limit == NONE
    arena[out[LIMIT]] = state.limit
    if state.limit == NONE:
        state.plausible_time = arena[TIME]
    arena[out[PLAUSIBLE_TIME]] = state.plausible_time
    for side in range(2):
        step_leg(arena, at, sizes, side, reference.motion, &reference.legs[side], out + side * OF_LEG)
    return OK


cdef inline void of_tables(double *arena, const Walker *at, const Walker *sizes, State *state,
        Reference *out) noexcept nogil:
    """Compute the reference of an adult at the speed of the schedule."""
    cdef const Variation *variation = <const Variation *>(arena + at.variation)
    cdef double height = arena[at.table]            # of the body, m
    cdef double slope = arena[at.table + 1]         # of the way; the coefficients follow
    cdef Course course
    cdef Blend *row = &state.blend
    cdef LegReference *leg
    cdef Path hips, ahead
    cdef Path phases[2]
    cdef double stride, first, second
    cdef int side, j

    # 1. Speed, and the row of the tables for it.
    at_time(arena + at.pieces, sizes.pieces // 8, arena[TIME], &course)
    blend(arena + at.knots, sizes.knots - 1, arena + at.table + 2, &course, row)
    ease(course.speed / SHUFFLE if 0.0 < course.speed < SHUFFLE else <double>(course.speed > 0.0), &stride, &first,
        &second)
    # 2. Phases of the legs, their motion, and that of the pelvis.
    advance(state, variation, &course, phases)
    joints(row, phases, out.legs[0].q, out.legs[1].q, out.legs[0].moments, out.legs[1].moments, &hips, &ahead)
    out.motion[0] = state.distance + height * ahead.x
    out.motion[2] = course.speed + height * ahead.v
    out.motion[4] = course.rate + height * ahead.a
    out.motion[1] = slope * state.distance + height * hips.x
    out.motion[3] = slope * course.speed + height * hips.v
    out.motion[5] = slope * course.rate + height * hips.a
    out.motion[6], out.motion[7], out.motion[8] = row.value[PITCH], row.first[PITCH], row.second[PITCH]
    out.walking_speed = course.speed
    # 3. Variation of the stride, and the ground, which both feet share in a stand.
    for side in range(2):
        leg = &out.legs[side]
        leg.phase = phases[side].x
        vary(&state.draws[side], variation, row.value + 2, &phases[side], leg.q, leg.moments)
        contact(row, leg.phase, &leg.vertical, &leg.forward, &leg.centre)
        leg.vertical = 0.5 + stride * (leg.vertical - 0.5)
        leg.forward *= stride
    state.phase_rate, state.phase_acceleration = phases[0].v, phases[0].a
    state.speed, state.speed_rate = course.speed, course.rate


cdef inline void of_recording(const double *samples, int count, double time, State *state,
        Reference *out) noexcept nogil:
    """Compute the reference of a recorded adult."""
    cdef Play now
    cdef LegReference *leg
    cdef int side, j
    play(samples, count, time, &now)
    out.motion[0], out.motion[2], out.motion[4] = state.distance, now.paths[SPEED_PATH].x, now.paths[SPEED_PATH].v
    out.motion[1], out.motion[3], out.motion[5] = (
        now.paths[HEIGHT_PATH].x, now.paths[HEIGHT_PATH].v, now.paths[HEIGHT_PATH].a)
    out.motion[6], out.motion[7], out.motion[8] = (
        now.paths[PITCH_PATH].x, now.paths[PITCH_PATH].v, now.paths[PITCH_PATH].a)
    out.walking_speed = now.values[MEAN_SPEED - PHASES]
    for side in range(2):
        leg = &out.legs[side]
        leg.phase = now.values[side]
        for j in range(3):
            leg.q[j] = now.paths[3 * side + j]
            leg.moments[j] = now.values[MOMENTS - PHASES + 3 * side + j]
        leg.vertical = now.values[VERTICAL - PHASES + side]
        leg.forward = now.values[FORWARD - PHASES + side]
        leg.centre = now.values[CENTRE - PHASES + side]
    state.phase_rate, state.phase_acceleration = now.phase_rate, 0.0
    state.speed, state.speed_rate = out.motion[2], out.motion[4]


cdef inline void advance(State *state, const Variation *variation, const Course *course, Path *phases) noexcept nogil:
    """Compute the phases, the right leg's half a stride ahead of the left one's, and draw what a new stride needs."""
    cdef double frequency = state.blend.value[FREQUENCY]
    cdef double frequency_rate = state.blend.first[FREQUENCY]
    cdef double gate, gate_first, gate_second, value, first, second, move, rest
    cdef int side
    for side in range(2):
        phases[side].x = state.phase + 0.5 * side
        follow(&state.draws[side], side, <uint64_t>variation.seed, floor(phases[side].x))
        phases[side].x -= floor(phases[side].x)
    if course.speed < HALT:             # the stride slows down to a stand
        ease(course.speed / HALT if course.speed > 0.0 else 0.0, &gate, &gate_first, &gate_second)
        frequency_rate = frequency_rate * gate + frequency * gate_first * course.rate / HALT
        frequency *= gate
    ease(phases[0].x, &value, &first, &second)
    move = variation.stride_time * (state.draws[0].after[STRIDE_TIME] - state.draws[0].before[STRIDE_TIME])
    rest = 1.0 + variation.stride_time * state.draws[0].before[STRIDE_TIME] + move * value
    phases[0].v = phases[1].v = frequency * rest
    phases[0].a = phases[1].a = frequency_rate * rest + frequency * move * first * phases[0].v


cdef inline void vary(const Draws *draws, const Variation *variation, const double *means, const Path *phase,
        Path *q, double *moments) noexcept nogil:
    """Apply gain and offset of the stride to the joints of a leg. means : of the angles; phase : of the leg"""
    cdef double s, first, second, v, a, gain, gain_v, gain_a, swing
    cdef int j
    ease(phase.x, &s, &first, &second)
    v = first * phase.v
    a = second * phase.v * phase.v + first * phase.a
    for j in range(3):
        gain_a = variation.gain[j] * (draws.after[j] - draws.before[j])
        gain = variation.gain[j] * draws.before[j] + gain_a * s
        gain_v = gain_a * v
        gain_a *= a
        swing = q[j].x - means[j]
        q[j].a += gain_a * swing + 2.0 * gain_v * q[j].v + gain * q[j].a
        q[j].v += gain_v * swing + gain * q[j].v
        q[j].x += gain * swing
        swing = variation.offset[j] * (draws.after[3 + j] - draws.before[3 + j])
        q[j].x += variation.offset[j] * draws.before[3 + j] + swing * s
        q[j].v += swing * v
        q[j].a += swing * a
        moments[j] *= 1.0 + gain


cdef inline void step_leg(double *arena, const Walker *at, const Walker *sizes, int side, const double *pelvis,
        const LegReference *reference, const int32_t *out) noexcept nogil:
    """Write the outputs of a leg. pelvis : its motion"""
    cdef const double *body = arena + at.body
    cdef const Muscle *muscles = <const Muscle *>(arena + at.muscles)
    cdef State *state = <State *>(arena + at.state)
    cdef Leg *leg = &state.legs[side]
    cdef const double *delayed = arena + at.history + 12 * <int>state.head + 6 * side
    cdef double angle[3]
    cdef double rate[3]
    cdef double acceleration[3]
    cdef double arms_x[3]
    cdef double arms_z[3]
    cdef double nominal, torque, vertical, forward, centre, foot, borne
    cdef Geometry g
    cdef int j

    for j in range(3):
        angle[j] = reference.q[j].x + leg.deviation[j]
        rate[j] = reference.q[j].v + leg.velocity[j]
        acceleration[j] = reference.q[j].a + leg.acceleration[j]
        nominal = body[MASS] * reference.moments[j]
        leg.angle[j] = reference.q[j].x
        leg.stiffness[j] = muscles[j].stiffness + muscles[j].per_moment * fabs(nominal)
        leg.damping[j] = muscles[j].damping + muscles[j].per_stiffness * leg.stiffness[j]
        leg.reflex[j] = -muscles[j].reflex_stiffness * delayed[j] - muscles[j].reflex_damping * delayed[3 + j]
        torque = (nominal - leg.yielded[j] - leg.stiffness[j] * leg.deviation[j] - leg.damping[j] * leg.velocity[j]
            + leg.reflex[j])
        arena[out[5 * j + ANGLE]] = angle[j]
        arena[out[5 * j + VELOCITY]] = rate[j]
        arena[out[5 * j + ACCELERATION]] = acceleration[j]
        arena[out[5 * j + TORQUE]] = torque
        arena[out[5 * j + POWER]] = torque * rate[j]
    directions(&g, pelvis[6], angle)
    segments(arena, body, &g, pelvis, angle, rate, acceleration, out)

    # Ground: the reference force, and the reaction of the body to the deviation of the leg under it.
    leg.load = clip(reference.vertical, 0.0, 1.0)
    leg.centre = body[HEEL] + body[FOOT_LENGTH] * clip(reference.centre, 0.02, 0.95)
    foot = (arena[out[PITCHES + 2]] - deviation_of_foot(leg.deviation)) / FLAT_RANGE
    leg.flat = FLAT_STIFFNESS * leg.load / (1.0 + foot * foot)
    contact_arms(body, &g, leg.centre, arms_x, arms_z)
    borne = leg.load * body[BODY_MASS]
    vertical = body[WEIGHT] * reference.vertical - clip(borne * of_pitches(arms_z, leg.acceleration), -body[WEIGHT], body[WEIGHT])
    forward = body[WEIGHT] * reference.forward - clip(borne * of_pitches(arms_x, leg.acceleration), -body[WEIGHT], body[WEIGHT])
    if vertical < 0.0:
        vertical = forward = 0.0
    arena[out[GROUND_FORCE]] = forward
    arena[out[GROUND_FORCE] + 1] = vertical
    arena[out[CONTACT]] = vertical > CONTACT_LOAD * body[WEIGHT]
    centre = leg.centre - body[HEEL]
    if vertical > CONTACT_LOAD * body[WEIGHT]:
        centre -= leg.flat * deviation_of_foot(leg.deviation) / vertical
        centre = clip(centre, 0.0, body[FOOT_LENGTH])
    arena[out[CENTRE_OF_PRESSURE]] = centre
    arena[out[PHASE]] = reference.phase


cdef inline double deviation_of_foot(const double *q) noexcept nogil:
    return q[0] - q[1] + q[2]


cdef inline double of_pitches(const double *arms, const double *q) noexcept nogil:
    """Return the sum over thigh, shank and foot of arm times pitch."""
    return arms[0] * q[0] + arms[1] * (q[0] - q[1]) + arms[2] * (q[0] - q[1] + q[2])


cdef inline void segments(double *arena, const double *body, const Geometry *g, const double *pelvis,
        const double *angle, const double *rate, const double *acceleration, const int32_t *out) noexcept nogil:
    """Write pitch and motion of thigh, shank and foot: proximal joint and pitch with two derivatives."""
    cdef double motion[9]
    cdef double length, v, a
    cdef Direction d
    cdef int j, k
    memmove(motion, pelvis, sizeof(motion))
    for j in range(3):
        if j:
            d = g.thigh if j == 1 else g.shank
            length = body[THIGH_LENGTH] if j == 1 else body[SHANK_LENGTH]
            v, a = motion[7], motion[8]
            motion[0] += length * d.s
            motion[1] -= length * d.c
            motion[2] += length * v * d.c
            motion[3] += length * v * d.s
            motion[4] += length * (a * d.c - v * v * d.s)
            motion[5] += length * (a * d.s + v * v * d.c)
        k = -1 if j == 1 else 1         # flexion of the knee turns the shank backward
        motion[6] += k * angle[j]
        motion[7] += k * rate[j]
        motion[8] += k * acceleration[j]
        arena[out[PITCHES + j]] = motion[6]
        memmove(arena + out[MOTIONS + j], motion, sizeof(motion))


cdef int walker_update(double *arena, const Walker *at, const Walker *sizes) noexcept nogil:
    cdef State *state = <State *>(arena + at.state)
    cdef const int32_t *assistance = each(at, at.inputs)
    cdef double dt = arena[DT]
    cdef double pitch = arena[each(at, at.outputs)[PELVIS_MOTION] + 6]
    cdef double *oldest = arena + at.history + 12 * <int>state.head
    cdef double torque[3]
    cdef double share = dt / (dt + ADAPTATION_TIME)
    cdef double *yielded
    cdef int side, j
    for side in range(2):
        yielded = state.legs[side].yielded
        for j in range(3):
            oldest[6 * side + j] = state.legs[side].deviation[j]
            oldest[6 * side + 3 + j] = state.legs[side].velocity[j]
            torque[j] = arena[assistance[3 * side + j]] - yielded[j]
            yielded[j] += share * (arena[at.adaptation] * arena[assistance[3 * side + j]] - yielded[j])
        j = move_leg(arena + at.body, <const Muscle *>(arena + at.muscles), pitch, dt, torque, &state.legs[side])
        if state.limit == NONE:
            state.limit = j
    state.head += 1.0
    if 12 * <int>state.head >= sizes.history:
        state.head = 0.0
    state.phase += dt * (state.phase_rate + 0.5 * dt * state.phase_acceleration)
    state.distance += dt * (state.speed + 0.5 * dt * state.speed_rate)
    return OK


cdef inline int move_leg(const double *body, const Muscle *muscles, double pelvis, double dt, const double *torque,
        Leg *leg) noexcept nogil:
    """Advance the deviation by one step, with the stiffness and the damping at its end. (Linearly implicit Euler)

    (M + h B + h² K) v' = M v + h (τ + τ_reflex - K x),  x' = x + h v'

    Returns the limit that the leg exceeds, NONE for none.
    """
    cdef double angle[3]
    cdef double arms_x[3]
    cdef double arms_z[3]
    cdef double momentum[3]
    cdef double spring[3]
    cdef double stiffness, damping, stop, share
    cdef Geometry g
    cdef Symmetric m, k, held
    cdef int limit = NONE
    cdef int j
    for j in range(3):
        angle[j] = leg.angle[j] + leg.deviation[j]
    directions(&g, pelvis, angle)
    contact_arms(body, &g, leg.centre, arms_x, arms_z)
    m = inertia(body, &g, leg.load * body[BODY_MASS], arms_x, arms_z)
    k = gravity(body, &g, leg.load, leg.flat)
    # 1. Momentum. Landing keeps it, while the body's mass is added; a release takes that mass away at its velocity;
    # and a moving geometry does no work on the deviation. So none of the three adds energy to it.
    held = m
    if leg.former.hh > 0.0:
        share = 0.0 if leg.load > leg.former_load else 1.0 if leg.load < leg.former_load else 0.5
        mix(&held, &leg.former, share)
    leg.former, leg.former_load = m, leg.load
    times(&held, leg.velocity, momentum)
    times(&k, leg.deviation, spring)
    # 2. Matrix of the step. Gravity and ground are damped as they are stiff, by 20 ms.
    m.hh += dt * (dt + 0.02) * k.hh
    m.hk += dt * (dt + 0.02) * k.hk
    m.ha += dt * (dt + 0.02) * k.ha
    m.kk += dt * (dt + 0.02) * k.kk
    m.ka += dt * (dt + 0.02) * k.ka
    m.aa += dt * (dt + 0.02) * k.aa
    for j in range(3):
        stiffness, damping = leg.stiffness[j], leg.damping[j]
        stop = beyond(angle[j], &muscles[j]) - beyond(leg.angle[j], &muscles[j])
        spring[j] += stiffness * leg.deviation[j] + RANGE_STIFFNESS * stop
        if fabs(stop) > RANGE_MARGIN:
            limit = HIP_STOP + j
        if stop != 0.0:
            stiffness += RANGE_STIFFNESS
            damping += RANGE_DAMPING
        damping = dt * (damping + dt * stiffness)
        if j == 0:
            m.hh += damping
        elif j == 1:
            m.kk += damping
        else:
            m.aa += damping
        momentum[j] += dt * (torque[j] + leg.reflex[j] - spring[j])
    solve(&m, momentum)
    for j in range(3):
        leg.acceleration[j] = (momentum[j] - leg.velocity[j]) / dt
        leg.velocity[j] = momentum[j]
        leg.deviation[j] += dt * momentum[j]
    return limit


cdef inline double beyond(double angle, const Muscle *muscle) noexcept nogil:
    """Return how far an angle is outside the range of its joint."""
    if angle < muscle.lower:
        return angle - muscle.lower
    return angle - muscle.upper if angle > muscle.upper else 0.0


walker = export(<kernel_t>walker_kernel, WALKER)
walker_next = export(<kernel_t>walker_update, WALKER)


def layout():
    """Return the size of the state in doubles, and the indices of what is -1 at the start: strides, blended speed."""
    cdef State *state = NULL
    return sizeof(State) // sizeof(double), [
        <size_t>&state.draws[0].stride // sizeof(double),
        <size_t>&state.draws[1].stride // sizeof(double),
        <size_t>&state.blend.speed // sizeof(double),
    ]
