# cython: freethreading_compatible=True
"""Walking adult: reference motion, deviation under assistance, muscles, ground forces."""

from libc.math cimport cos, fabs, floor, sin
from libc.stdint cimport int32_t, uint64_t
from libc.string cimport memmove

from cext.abi cimport DT, ITEMS, OK, TIME, Rest, each, export, items, kernel_t
from cext.kernels.limits cimport clip
from cext.kernels.wearer.leg cimport (
    ANKLE_HEIGHT, FOOT_LENGTH, HEEL, MASS, SHANK_LENGTH, SIZE, THIGH_LENGTH, TRUNK_INERTIA, TRUNK_MOMENT, WEIGHT, Chain,
    Direction, Geometry, Symmetric, chain, demand, directions, dot, inertia, of_joints, pitches, solve,
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

cdef enum:
    KNEE = 1

cdef enum: # outputs behind those of both legs
    PELVIS_MOTION = 2 * OF_LEG
    WALKING_SPEED, PLAUSIBLE, LIMIT, PLAUSIBLE_TIME, METABOLIC_POWER, METABOLIC_CHANGE

cdef enum: # limits of people, in the order of `limits` in the class
    NONE, HIP_STOP, KNEE_STOP, ANKLE_STOP, TRUNK_TILT, FALL, SLIP, TRIP, TOPPLE

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
    double nominal[3]           # torque of the muscles of the reference, N·m
    double stiffness[3]
    double damping[3]
    double reflex[3]            # torque of the delayed muscles
    double load                 # share of the body weight
    double flat                 # stiffness of the ground under a flat foot, N·m/rad
    double reference[2]         # force of the ground, forward and up, without the robot, N
    double vertical             # force of the ground, N
    Chain chain
    double demand[3]            # torque of the pitches that the motion demands beyond the reference, N·m
    double inertial[2]          # force at the hip that it demands
    double gap                  # height of the point of contact over that of the reference, m
    double slide[2]             # its velocity, forward and up, beyond the reference, m/s
    double deviation[3]
    double velocity[3]
    double acceleration[3]
    double yielded[3]           # torque that the muscles leave to the robot, N·m
    double reacted[3]           # of that, in reaction to a torque that they did not expect
    double balance[3]           # torque of the muscles for the balance of the trunk, N·m
    double ground[2]            # force of the ground beyond the reference, N
    double moment               # of the ground on the foot for the balance, N·m
    double borne[3]             # torque of the muscles that bear the reference force on a leg elsewhere, N·m
    double carried              # moment of the ground on the foot for that, N·m
    double slip                 # distance, m
    double toppling             # time for which the centre of pressure should be outside of the foot, s

cdef struct Pelvis:             # deviation forward and up, m, and in pitch, rad
    double deviation[3]
    double velocity[3]
    double acceleration[3]

cdef struct Contact:            # of a foot with the ground, beyond the reference
    double force[2]             # forward and up, without the acceleration of the step, N
    double change[2]            # of the force with that acceleration, kg
    double tilt                 # torque of the leg's pitches on the pelvis, N·m
    double slipping             # velocity of a foot beyond its friction, m/s

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
    double disturbed            # whether a torque has ever acted
    double trained              # share of a helpful torque that the wearer expects
    double effort, usual_effort # metabolic power of the muscles, with the robot and without, W
    Pelvis pelvis
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

cdef double GRAVITY = 9.80665       # m/s²
cdef double FLAT_STIFFNESS = 600.0  # N·m/rad of the ground under the flat foot that bears the body weight
cdef double FLAT_RANGE = 0.1    # rad, pitch of a foot that still touches with heel and ball
cdef double CONTACT_LOAD = 0.03 # body weights, least load of a foot in contact
cdef double SHUFFLE = 0.25      # m/s, speed below which both feet keep their load
cdef double HALT = 0.15         # m/s, speed below which the stride slows down to a stand
cdef double ADAPTATION_TIME = 0.05      # s
cdef double RESTING_POWER = 1.4         # W/kg, metabolic
cdef double WORK_COST = 1.42            # metabolic power per positive power of the muscles
cdef double DETUNING = 4.0              # W per kg and (N·m/kg)², of torque that the calf no longer stores in its tendon
cdef double TRAINED_SPEED = 0.3         # m/s, below which a wearer expects a torque less
cdef double KNEE_TRAINED = 0.5          # of what the wearer expects at hip and ankle
cdef double RESISTANCE = 0.6    # of the adaptation, against an opposing torque
cdef double RANGE_STIFFNESS = 800.0     # N·m/rad outside the range of a joint
cdef double RANGE_DAMPING = 20.0        # N·m·s/rad
cdef double RANGE_MARGIN = 0.0873       # rad beyond the range that ligaments bear
# Ground under the foot that bears the body weight, per kg: heel pad and shoe in s⁻² and s⁻¹, sole in s⁻¹.
cdef double PAD_STIFFNESS = 430.0
cdef double PAD_DAMPING = 30.0
cdef double SOLE_DAMPING = 300.0
cdef double FRICTION = 0.6
# Balance of the pelvis: place per kg, pitch of the trunk per kg·m², in s⁻² and s⁻¹.
cdef double PLACE_STIFFNESS = 1.0
cdef double PLACE_DAMPING = 2.0
cdef double TILT_STIFFNESS = 2.0
cdef double TILT_DAMPING = 0.3
cdef double FASTEST = 20.0      # rad/s of a pitch, above which centrifugal forces grow no more
cdef double TILT_LIMIT = 0.524  # rad of the trunk
cdef double FALL_LIMIT = 0.15   # m that the hips are too low
cdef double SLIP_LIMIT = 0.1    # m
cdef double TRIP_LIMIT = 0.04   # m under the ground of a swinging foot
cdef double TOPPLE_LIMIT = 0.1  # m of a centre of pressure outside of the foot
cdef double TOPPLE_TIME = 0.2   # s


cdef int walker_kernel(double *arena, const Walker *at, const Walker *sizes) noexcept nogil:
    cdef State *state = <State *>(arena + at.state)
    cdef const int32_t *out = each(at, at.outputs)
    cdef Reference reference
    cdef double pelvis[9]
    cdef int side, k
    if sizes.samples > SAMPLE:
        of_recording(arena + at.samples, sizes.samples // SAMPLE, arena[TIME], state, &reference)
    else:
        of_tables(arena, at, sizes, state, &reference)
    for k in range(9):
        pelvis[k] = reference.motion[k]
    if state.disturbed:
        for k in range(2):
            pelvis[k] += state.pelvis.deviation[k]
            pelvis[2 + k] += state.pelvis.velocity[k]
            pelvis[4 + k] += state.pelvis.acceleration[k]
        pelvis[6] += state.pelvis.deviation[2]
        pelvis[7] += state.pelvis.velocity[2]
        pelvis[8] += state.pelvis.acceleration[2]
    memmove(arena + out[PELVIS_MOTION], pelvis, sizeof(pelvis))
    arena[out[WALKING_SPEED]] = reference.walking_speed
    state.trained = clip(reference.walking_speed / TRAINED_SPEED, 0.0, 1.0)
    state.effort = state.usual_effort = 0.0
    for side in range(2):
        step_leg(arena, at, sizes, side, pelvis, reference.motion, &reference.legs[side], out + side * OF_LEG)
    arena[out[PLAUSIBLE]] = state.limit == NONE
    arena[out[LIMIT]] = state.limit
    arena[out[METABOLIC_POWER]] = RESTING_POWER * (arena + at.body)[MASS] + state.effort
    arena[out[METABOLIC_CHANGE]] = state.effort - state.usual_effort
    if state.limit == NONE:
        state.plausible_time = arena[TIME]
    arena[out[PLAUSIBLE_TIME]] = state.plausible_time
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
        const double *usual, const LegReference *reference, const int32_t *out) noexcept nogil:
    """Write the outputs of a leg. pelvis, usual : motion of the pelvis, with the robot and without"""
    cdef const double *body = arena + at.body
    cdef const Muscle *muscles = <const Muscle *>(arena + at.muscles)
    cdef State *state = <State *>(arena + at.state)
    cdef Leg *leg = &state.legs[side]
    cdef const double *delayed = arena + at.history + 12 * <int>state.head + 6 * side
    cdef double angle[3]
    cdef double rate[3]
    cdef double acceleration[3]
    cdef double nominal, torque, vertical, forward, centre, foot, turned, outside
    cdef Geometry g
    cdef int j

    for j in range(3):
        angle[j] = reference.q[j].x + leg.deviation[j]
        rate[j] = reference.q[j].v + leg.velocity[j]
        acceleration[j] = reference.q[j].a + leg.acceleration[j]
        nominal = body[MASS] * reference.moments[j]
        leg.angle[j], leg.nominal[j] = reference.q[j].x, nominal
        leg.stiffness[j] = muscles[j].stiffness + muscles[j].per_moment * fabs(nominal - leg.yielded[j])
        leg.damping[j] = muscles[j].damping + muscles[j].per_stiffness * leg.stiffness[j]
        leg.reflex[j] = -muscles[j].reflex_stiffness * delayed[j] - muscles[j].reflex_damping * delayed[3 + j]
        torque = (nominal - leg.yielded[j] - leg.stiffness[j] * leg.deviation[j] - leg.damping[j] * leg.velocity[j]
            + leg.reflex[j] + leg.balance[j] + leg.borne[j])
        arena[out[5 * j + ANGLE]] = angle[j]
        arena[out[5 * j + VELOCITY]] = rate[j]
        arena[out[5 * j + ACCELERATION]] = acceleration[j]
        arena[out[5 * j + TORQUE]] = torque
        arena[out[5 * j + POWER]] = torque * rate[j]
        state.effort += effort(j, torque, torque * rate[j], body[MASS])
        if j == 2 and leg.yielded[j] * nominal > 0.0:
            state.effort += DETUNING * leg.yielded[j] * leg.yielded[j] / body[MASS]
        state.usual_effort += effort(j, nominal, nominal * reference.q[j].v, body[MASS])
    directions(&g, pelvis[6], angle)
    segments(arena, body, &g, pelvis, angle, rate, acceleration, out)

    # Ground: the reference force, and the reaction of the body to the deviation of the leg under it.
    leg.load = clip(reference.vertical, 0.0, 1.0)
    centre = body[HEEL] + body[FOOT_LENGTH] * clip(reference.centre, 0.02, 0.95)
    turned = state.pelvis.deviation[2] + deviation_of_foot(leg.deviation)
    foot = (arena[out[PITCHES + 2]] - turned) / FLAT_RANGE
    leg.flat = FLAT_STIFFNESS * leg.load / (1.0 + foot * foot)
    leg.reference[0], leg.reference[1] = body[WEIGHT] * reference.forward, body[WEIGHT] * reference.vertical
    forward, vertical = leg.reference[0] + leg.ground[0], leg.reference[1] + leg.ground[1]
    if state.disturbed:
        compare(body, &g, pelvis, usual, rate, reference, centre, leg)
        if not pelvis[1] + lowest(body, leg, &g) > -TRIP_LIMIT and leg.load == 0.0 and reference.phase < 0.9:
            if state.limit == NONE and arena[at.table + 1] == 0.0:
                state.limit = TRIP
    if vertical < 0.0:
        vertical = forward = 0.0
    arena[out[GROUND_FORCE]] = forward
    arena[out[GROUND_FORCE] + 1] = vertical
    arena[out[CONTACT]] = vertical > CONTACT_LOAD * body[WEIGHT]
    leg.vertical = vertical
    centre -= body[HEEL]
    if vertical > CONTACT_LOAD * body[WEIGHT]:
        centre += (leg.moment + leg.carried - leg.flat * turned) / vertical
        outside = fabs(centre - 0.5 * body[FOOT_LENGTH]) - 0.5 * body[FOOT_LENGTH]
        leg.toppling = 0.0 if outside <= TOPPLE_LIMIT or leg.load < 0.5 else leg.toppling + arena[DT]
        if leg.toppling > TOPPLE_TIME and state.limit == NONE:
            state.limit = TOPPLE
        centre = clip(centre, 0.0, body[FOOT_LENGTH])
    arena[out[CENTRE_OF_PRESSURE]] = centre
    arena[out[PHASE]] = reference.phase


cdef inline double effort(int joint, double torque, double power, double mass) noexcept nogil:
    """Return the metabolic power of the muscles of a joint in W, of their work and of their torque."""
    cdef double share = 1.5 if joint == 0 else 3.0 if joint == 1 else 0.6       # W per kg and (N·m/kg)²
    return share * torque * torque / mass + (WORK_COST * power if power > 0.0 else 0.0)


cdef inline double deviation_of_foot(const double *q) noexcept nogil:
    return q[0] - q[1] + q[2]


cdef inline double lowest(const double *body, const Leg *leg, const Geometry *g) noexcept nogil:
    """Return the height of the lower one of heel and ball over the hip."""
    cdef double ankle = -leg.chain.px[0] - leg.chain.px[1] - body[ANKLE_HEIGHT] * g.foot.c
    cdef double ball = body[HEEL] + 0.72 * body[FOOT_LENGTH]
    return ankle + (body[HEEL] * g.foot.s if body[HEEL] * g.foot.s < ball * g.foot.s else ball * g.foot.s)


cdef inline void compare(const double *body, const Geometry *g, const double *pelvis, const double *usual,
        const double *rate, const LegReference *reference, double centre, Leg *leg) noexcept nogil:
    """Compute what the motion of a leg demands beyond that of the reference, and where its point of contact is.

    Both have the accelerations of the reference: the deviation's own are those that the update computes. Muscles that
    bear the body also hold the leg up; gravity moves the rest of the leg.
    """
    cdef double rates[3]
    cdef double usual_rates[3]
    cdef double accelerations[3]
    cdef double q[3]
    cdef double torque[3]
    cdef double force[2]
    cdef Geometry before
    cdef Chain usual_chain
    cdef double up = usual[5] + GRAVITY * (1.0 - leg.load)
    cdef int j
    for j in range(3):
        q[j] = reference.q[j].v
    pitches(usual[7], q, usual_rates)
    for j in range(3):
        q[j] = reference.q[j].a
    pitches(usual[8], q, accelerations)
    pitches(pelvis[7], rate, rates)
    directions(&before, usual[6], leg.angle)
    chain(&usual_chain, body, &before, centre)
    chain(&leg.chain, body, g, centre)
    for j in range(3):
        torque[j] = (usual_chain.px[j] - leg.chain.px[j]) * leg.reference[0]
        torque[j] += (usual_chain.pz[j] - leg.chain.pz[j]) * leg.reference[1]
        torque[j] += (leg.chain.wz[j] - usual_chain.wz[j]) * leg.load * GRAVITY
    leg.carried = torque[0] + torque[1] + torque[2]
    torque[2] -= leg.carried
    of_joints(torque, leg.borne)
    leg.gap = pelvis[1] + leg.chain.z - usual[1] - usual_chain.z
    leg.slide[0] = pelvis[2] - usual[2] + dot(leg.chain.px, rates) - dot(usual_chain.px, usual_rates)
    leg.slide[1] = pelvis[3] - usual[3] + dot(leg.chain.pz, rates) - dot(usual_chain.pz, usual_rates)
    for j in range(3):
        rates[j] = clip(rates[j], -FASTEST, FASTEST)
    demand(body, &leg.chain, rates, accelerations, usual[4], up, leg.demand, leg.inertial)
    demand(body, &usual_chain, usual_rates, accelerations, usual[4], up, torque, force)
    for j in range(3):
        leg.demand[j] -= torque[j]
    leg.inertial[0] -= force[0]
    leg.inertial[1] -= force[1]


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
    cdef double *oldest = arena + at.history + 12 * <int>state.head
    cdef double torque[6]
    cdef double share = dt / (dt + ADAPTATION_TIME)
    cdef double applied
    cdef Leg *leg
    cdef bint moving = state.disturbed != 0.0    # the step has prepared it
    cdef int side, j, limit
    for side in range(2):
        leg = &state.legs[side]
        for j in range(3):
            oldest[6 * side + j] = leg.deviation[j]
            oldest[6 * side + 3 + j] = leg.velocity[j]
            applied = arena[assistance[3 * side + j]]
            if not applied == 0.0:
                state.disturbed = 1.0
            torque[3 * side + j] = applied - leg.yielded[j]
            yield_to(applied, arena[at.adaptation], (KNEE_TRAINED if j == KNEE else 1.0) * state.trained, share, j, leg)
    if moving:
        limit = move(arena + at.body, <const Muscle *>(arena + at.muscles), dt, torque, state)
        if state.limit == NONE:
            state.limit = limit
    state.head += 1.0
    if 12 * <int>state.head >= sizes.history:
        state.head = 0.0
    state.phase += dt * (state.phase_rate + 0.5 * dt * state.phase_acceleration)
    state.distance += dt * (state.speed + 0.5 * dt * state.speed_rate)
    return OK


cdef inline void yield_to(double applied, double adaptation, double trained, double share, int j,
        Leg *leg) noexcept nogil:
    """Compute the torque that the muscles of a joint leave to the robot.

    Trained wearers expect a torque in the direction of their own while they walk, and yield to it in phase, as far as
    they have one. To any other torque they react with a delay, to an opposing one less.

    trained : share of a helpful torque that is expected
    """
    cdef double own = leg.nominal[j]
    cdef double helped = 0.0
    cdef double reaction = RESISTANCE * adaptation * applied
    if applied * own > 0.0:
        helped = trained * adaptation * (applied if fabs(applied) < fabs(own) else own)
        reaction = (1.0 - trained) * adaptation * applied
    leg.reacted[j] += share * (reaction - leg.reacted[j])
    leg.yielded[j] = helped + leg.reacted[j]


cdef inline int move(const double *body, const Muscle *muscles, double dt, const double *torque,
        State *state) noexcept nogil:
    """Advance the deviation of the body by one step, with the forces at its end. (Linearly implicit Euler)

    (M + h B + h² K) a = τ - B v - K (x + h v) - what the motion demands,  v' = v + h a,  x' = x + h v'

    The unknowns of each leg are eliminated, then those of the pelvis are solved for. Returns the limit that the body
    exceeds, NONE for none.
    """
    cdef Pelvis *pelvis = &state.pelvis
    cdef Contact contacts[2]
    cdef double a[2][4][3]      # of each leg: change of its accelerations with those of the pelvis, and their rest
    cdef Symmetric m            # of the pelvis: forward, up, pitch
    cdef double right[3]
    cdef double column[3][3]    # of a leg: its inertia to the pelvis forward, up and in pitch
    cdef double place[3]
    cdef double s = pelvis.deviation[2]
    cdef double c = cos(s)
    cdef double loads = state.legs[0].load + state.legs[1].load
    cdef double share, push, tilt, place_change, tilt_change, swing, held
    cdef Leg *leg
    cdef int side, j, k, limit = NONE
    s = sin(s)
    # 1. Trunk, and its balance: the legs that bear the body transmit force and moment from the ground.
    share = 1.0 if loads > 0.0 else 0.0
    place_change = share * dt * body[MASS] * (PLACE_DAMPING + dt * PLACE_STIFFNESS)
    tilt_change = share * dt * body[SIZE] * (TILT_DAMPING + dt * TILT_STIFFNESS)
    push = -share * body[MASS] * (PLACE_STIFFNESS * (pelvis.deviation[0] + dt * pelvis.velocity[0])
        + PLACE_DAMPING * pelvis.velocity[0])
    tilt = -share * body[SIZE] * (TILT_STIFFNESS * (pelvis.deviation[2] + dt * pelvis.velocity[2])
        + TILT_DAMPING * pelvis.velocity[2])
    m.hh, m.hk, m.ha = body[MASS] + place_change, 0.0, -body[TRUNK_MOMENT] * c
    m.kk, m.ka, m.aa = body[MASS], -body[TRUNK_MOMENT] * s, body[TRUNK_INERTIA] + tilt_change
    swing = body[TRUNK_MOMENT] * clip(pelvis.velocity[2] * pelvis.velocity[2], 0.0, FASTEST * FASTEST)
    right[0] = push - swing * s
    right[1] = swing * c
    right[2] = tilt
    # 2. Legs.
    for side in range(2):
        leg = &state.legs[side]
        j = eliminate(body, muscles, dt, torque + 3 * side, pelvis, leg, &contacts[side], column, a[side])
        limit = j if j else limit
        right[0] += contacts[side].force[0] - leg.inertial[0]
        right[1] += contacts[side].force[1] - leg.inertial[1]
        right[2] += contacts[side].tilt
        m.hh += contacts[side].change[0] - dot(column[0], a[side][0])
        m.hk -= dot(column[0], a[side][1])
        m.ha += column[0][0] - dot(column[0], a[side][2])
        m.kk += contacts[side].change[1] - dot(column[1], a[side][1])
        m.ka += column[1][0] - dot(column[1], a[side][2])
        m.aa += column[2][0] - dot(column[2], a[side][2])
        for k in range(3):
            right[k] -= dot(column[k], a[side][3])
    # 3. Accelerations, and the forces at the end of the step.
    solve(&m, right)
    push -= place_change * right[0]
    tilt -= tilt_change * right[2]
    held = GRAVITY * body[TRUNK_MOMENT] * s     # the tilt has its stiffness on top of gravity
    for side in range(2):
        leg = &state.legs[side]
        share = leg.load / loads if loads > 0.0 else 0.0
        for j in range(3):
            leg.acceleration[j] = a[side][3][j] - mixed(a[side], right, j)
            leg.velocity[j] += dt * leg.acceleration[j]
            leg.deviation[j] += dt * leg.velocity[j]
        pitches(right[2], leg.acceleration, place)
        leg.ground[0] = (share * push + contacts[side].force[0]
            - contacts[side].change[0] * (right[0] + dot(leg.chain.px, place)))
        leg.ground[1] = contacts[side].force[1] - contacts[side].change[1] * (right[1] + dot(leg.chain.pz, place))
        leg.moment = share * (tilt - held - push * (leg.chain.px[0] + leg.chain.px[1] + leg.chain.px[2]))
        for j in range(3):
            place[j] = -share * push * leg.chain.px[j]
        place[2] -= leg.moment
        of_joints(place, leg.balance)
        leg.slip = 0.0 if leg.load == 0.0 else leg.slip + dt * contacts[side].slipping
        if not fabs(leg.slip) <= SLIP_LIMIT:
            limit = SLIP
    for j in range(3):
        pelvis.acceleration[j] = right[j]
        pelvis.velocity[j] += dt * right[j]
        pelvis.deviation[j] += dt * pelvis.velocity[j]
    if not fabs(pelvis.deviation[2]) <= TILT_LIMIT:
        limit = TRUNK_TILT
    if not pelvis.deviation[1] >= -FALL_LIMIT:
        limit = FALL
    return limit


cdef inline double mixed(const double (*a)[3], const double *x, int j) noexcept nogil:
    return a[0][j] * x[0] + a[1][j] * x[1] + a[2][j] * x[2]


cdef inline void touch(const double *body, double dt, const Leg *leg, Contact *out) noexcept nogil:
    """Compute the force of the ground on a foot. Its friction is limited; a foot that pulls has left the ground."""
    cdef double mass = leg.load * body[MASS]
    cdef double grip = FRICTION * leg.vertical - fabs(leg.reference[0])
    cdef double sole = SOLE_DAMPING * mass
    out.slipping = 0.0
    out.force[1] = -mass * (PAD_STIFFNESS * (leg.gap + dt * leg.slide[1]) + PAD_DAMPING * leg.slide[1])
    if leg.reference[1] + out.force[1] < 0.0:
        out.force[0], out.force[1] = -leg.reference[0], -leg.reference[1]
        out.change[0] = out.change[1] = 0.0
        return
    if grip < 0.1 * leg.vertical:
        grip = 0.1 * leg.vertical
    if sole * fabs(leg.slide[0]) > grip:
        out.slipping = leg.slide[0]
        sole = grip / fabs(leg.slide[0])
    out.force[0] = -sole * leg.slide[0]
    out.change[0] = dt * sole
    out.change[1] = dt * mass * (PAD_DAMPING + dt * PAD_STIFFNESS)


cdef inline int eliminate(const double *body, const Muscle *muscles, double dt, const double *torque,
        const Pelvis *pelvis, const Leg *leg, Contact *contact, double (*column)[3], double (*a)[3]) noexcept nogil:
    """Solve the equations of a leg for its accelerations, as a[3] less a[k] times those of the pelvis.

    column : inertia of the joints to the pelvis forward, up and in pitch. Returns the limit that the leg exceeds.
    """
    cdef double more[3]
    cdef double f[3]
    cdef double x[3]
    cdef double z[3]
    cdef double damping, stiffness, stop
    cdef double free = 1.0 - leg.load
    cdef double turned = pelvis.deviation[2] + deviation_of_foot(leg.deviation)
    cdef double turning = pelvis.velocity[2] + deviation_of_foot(leg.velocity)
    cdef const Chain *g = &leg.chain
    cdef Symmetric m
    cdef int j, limit = NONE
    touch(body, dt, leg, contact)
    # 1. Pitches: ground, gravity and inertia. Gravity and a flat foot are damped as they are stiff, by 20 ms.
    pitches(pelvis.velocity[2], leg.velocity, x)
    for j in range(3):
        stiffness = fabs(free * GRAVITY * g.wx[j])
        f[j] = contact.force[0] * g.px[j] + contact.force[1] * g.pz[j] - leg.demand[j] - 0.02 * stiffness * x[j]
        more[j] = dt * (dt + 0.02) * stiffness
    f[2] -= leg.flat * (turned + (dt + 0.02) * turning)
    more[2] += dt * (dt + 0.02) * leg.flat
    m = inertia(body, g, contact.change[0], contact.change[1], more)
    for j in range(3):
        x[j] = g.wx[j] + contact.change[0] * g.px[j]
        z[j] = g.wz[j] + contact.change[1] * g.pz[j]
    of_joints(x, column[0])
    of_joints(z, column[1])
    column[2][0], column[2][1], column[2][2] = m.hh, m.hk, m.ha     # the hip moves the leg as the pelvis does
    of_joints(f, a[3])
    contact.tilt = a[3][0]
    # 2. Muscles and stops.
    for j in range(3):
        stiffness, damping = leg.stiffness[j], leg.damping[j]
        stop = beyond(leg.angle[j] + leg.deviation[j], &muscles[j]) - beyond(leg.angle[j], &muscles[j])
        if not fabs(stop) <= RANGE_MARGIN:
            limit = HIP_STOP + j
        a[3][j] += torque[j] + leg.reflex[j] - stiffness * leg.deviation[j] - RANGE_STIFFNESS * stop
        if stop != 0.0:
            stiffness += RANGE_STIFFNESS
            damping += RANGE_DAMPING
        damping += dt * stiffness
        a[3][j] -= damping * leg.velocity[j]
        if j == 0:
            m.hh += dt * damping
        elif j == 1:
            m.kk += dt * damping
        else:
            m.aa += dt * damping
    for j in range(3):
        a[0][j], a[1][j], a[2][j] = column[0][j], column[1][j], column[2][j]
    for j in range(4):
        solve(&m, a[j])
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
