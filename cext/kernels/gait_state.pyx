# cython: freethreading_compatible=True
"""Walking or standing, strides outside their envelope, and torques that fade with either."""

from libc.math cimport INFINITY, NAN, fabs, floor, isinf, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport clip, is_finite

cdef double AGREEMENT_TIME = 0.3        # s, time constant of the comparison of both legs
cdef double FOLLOWING_SHARE = 0.3       # of a stride, in which the predicted phase follows the estimate
cdef double PEAK_TIME = 5.0             # s, with which the largest velocity decays while both legs walk
cdef double STILL_SHARE = 0.15          # of the largest velocity in walking: a leg that is slower may stand
cdef double STILL_FLOOR = 0.25          # of still_velocity, below which the limit does not fall
cdef double STEP_TIME = 1.5             # s without a leg faster than still_velocity: the wearer stands
cdef double PAUSE_TIME = 1.5            # s below the limit after which a leg does not walk, whatever its phase
cdef double DIRECTION_SHARE = 0.9       # of a stride, time constant of the evidence of the direction
cdef double FIRST_STRIDE = 1.1          # s, until a stride was measured
cdef double SHORTEST_STRIDE = 0.5       # s, between two beginnings of the left phase
cdef double LONGEST_STRIDE = 3.0
cdef double DISCARD_TIME = 1.0          # s of a stand, after which a walk has ended
cdef double DIRECTION_AFTER = 0.5       # of a stride since a stand, in which each leg moves either way,
cdef double DIRECTION_KNOWN = 0.15      # and in which steps begin to show the direction
cdef double SHANK_LOW = 0.3             # evidence below which the wearer no longer walks forward,
cdef double SHANK_HIGH = 0.45           # and from which on walking forward begins
cdef double THIGH_LOW = 0.0
cdef double THIGH_HIGH = 0.15
cdef double KNEE_LOW = -0.3
cdef double KNEE_HIGH = -0.05
cdef double KNEE_TIME = 1.0             # s, of the high-pass for the angle of a knee
cdef double STUMBLE_LEAST = 0.09        # of a stride, by which one leg leads the other unusually much,
cdef double STUMBLE_MOST = 0.18         # or up to this in an uneven walk:
cdef double STUMBLE_TIMES = 5.0         # times the usual RMS
cdef double FIRST_SPREAD = 0.0015       # mean square, until strides of a walk show it
cdef double USUAL_SHARE = 0.3           # of a stride, in what is usual,
cdef double LEARNED_TIME = 0.2          # if both phases were known for so many s of it


cdef struct Direction:
    int32_t left_shank_velocity, right_shank_velocity, direction
    int32_t knees               # 1 if the velocities are those of knees
    int32_t evidence            # see below

cdef enum:
    SQUARES = 0                 # mean square of the rates of the shanks, left, then right
    CUBES = 2                   # their mean cubes
    COMMON = 4                  # mean of x, the mean of both velocities,
    APART_SQUARED = 5           # and of y, the square of half their difference
    XX = 6                      # means of their products
    YY = 7
    XY = 8
    AGE = 9                     # s since the left phase began
    PERIOD = 10                 # s between its last two beginnings
    LAST = 11                   # left phase one tick before
    FORWARD = 12                # 1 in walking forward
    ANGLE = 13                  # of each knee from its velocity, after a high-pass
    WEIGHT = 15                 # means of the weight of each knee,
    WEIGHTED = 17               # of its product with the velocity of the other knee,
    WEIGHTED_SQUARE = 19        # and with the square of that
    MOVED = 21                  # strides since the last stand


cdef inline bint forward(double *arena, const Direction *at, double phase, double left, double right) noexcept nogil:
    """Return whether the legs move as in walking forward. phase : of the left leg; left, right : velocities"""
    cdef double *m = arena + at.evidence
    cdef double stride, share, rate, other, x, y, variances
    cdef double evidence = INFINITY
    cdef double knees = 0.0
    cdef int side
    # 1. The means have a time constant in proportion to the stride.
    m[AGE] += arena[DT]
    if m[LAST] - phase > 0.5:
        if m[AGE] > SHORTEST_STRIDE:
            m[PERIOD] = min(LONGEST_STRIDE, m[AGE])
        m[AGE] = 0.0
    m[LAST] = phase
    stride = m[PERIOD] if m[PERIOD] > 0.0 else FIRST_STRIDE
    share = min(1.0, arena[DT] / (DIRECTION_SHARE * stride))
    m[MOVED] = min(1.0, m[MOVED] + arena[DT] / stride)
    # 2. A shank swings forward faster than it turns back in stance: its rate is skewed.
    for side in range(2):
        rate = arena[at.right_shank_velocity if side else at.left_shank_velocity]
        if is_finite(rate):
            m[SQUARES + side] += share * (rate * rate - m[SQUARES + side])
            m[CUBES + side] += share * (rate * rate * rate - m[CUBES + side])
    rate = m[SQUARES] * sqrt(m[SQUARES]) + m[SQUARES + 1] * sqrt(m[SQUARES + 1])
    # 3. So does a thigh: while the velocities differ most, the faster one is forward, and so is their mean.
    x = 0.5 * (left + right)
    y = 0.25 * (left - right) * (left - right)
    m[COMMON] += share * (x - m[COMMON])
    m[APART_SQUARED] += share * (y - m[APART_SQUARED])
    m[XX] += share * (x * x - m[XX])
    m[YY] += share * (y * y - m[YY])
    m[XY] += share * (x * y - m[XY])
    variances = (m[XX] - m[COMMON] * m[COMMON]) * (m[YY] - m[APART_SQUARED] * m[APART_SQUARED])
    if rate > 0.0:
        evidence = ((m[CUBES] + m[CUBES + 1]) / rate - SHANK_LOW) / (SHANK_HIGH - SHANK_LOW)
    elif variances > 0.0 and arena[at.knees] == 0.0:
        x = (m[XY] - m[COMMON] * m[APART_SQUARED]) / sqrt(variances)
        evidence = (x - THIGH_LOW) / (THIGH_HIGH - THIGH_LOW)
    # 4. While a knee is flexed in swing, the other one extends in stance.
    if rate == 0.0 and arena[at.knees] != 0.0:
        for side in range(2):
            rate = right if side else left
            other = left if side else right
            m[ANGLE + side] += arena[DT] * (rate - m[ANGLE + side] / KNEE_TIME)
            y = max(0.0, m[ANGLE + side])
            y *= y
            m[WEIGHT + side] += share * (y - m[WEIGHT + side])
            m[WEIGHTED + side] += share * (y * other - m[WEIGHTED + side])
            m[WEIGHTED_SQUARE + side] += share * (y * other * other - m[WEIGHTED_SQUARE + side])
            variances = m[WEIGHT + side] * m[WEIGHTED_SQUARE + side]
            if variances > 0.0:
                knees -= 0.5 * m[WEIGHTED + side] / sqrt(variances)
        evidence = (knees - KNEE_LOW) / (KNEE_HIGH - KNEE_LOW)
    # After a short stand the decision lasts until new steps show the direction.
    m[FORWARD] = (evidence >= 1.0 and m[MOVED] >= DIRECTION_AFTER) \
        or (m[FORWARD] != 0.0 and (evidence >= 0.0 or m[MOVED] < DIRECTION_KNOWN))
    arena[at.direction] = evidence if is_finite(evidence) else 0.0
    return m[FORWARD] != 0.0


cdef inline void forget(double *m, bint ended) noexcept nogil:
    """Discard the evidence of the direction, and the decision if the walk has ended: steps may go the other way."""
    cdef int i
    for i in range(MOVED + 1):
        if i < AGE or i > FORWARD or (i == FORWARD and ended):
            m[i] = 0.0


cdef struct State:
    int32_t left_phase, right_phase, left_walking, right_walking, left_velocity, right_velocity
    int32_t state, walking, standing, confidence, still_velocity, still_time, tolerance
    Direction direction
    int32_t track               # see below
    int32_t apart               # see below

STATE = items((<State *>ITEMS)[0], "evidence[22] track[6] apart[9]")

cdef enum:
    STILL = 0                   # s without motion, by the measure of slow walking
    APART = 1                   # mean deviation of the phases from half a stride
    FASTEST = 2                 # largest velocity in recent walking
    SLOW = 3                    # s below still_velocity
    LEFT_STILL = 4              # s without motion of one leg, by the measure of slow walking
    RIGHT_STILL = 5


cdef enum:
    USUAL = 0                   # mean of the left phase less the right one
    SPREAD = 1                  # mean square of the difference from it
    SUM = 2                     # of the differences of this stride of the left leg,
    SQUARES_SUM = 3             # of their squares,
    COUNT = 4                   # and their number
    STUMBLED = 5                # strides until a stumble has ended, left, then right
    BEFORE = 7                  # phase one tick before, left, then right


cdef inline bint stumbles(double *m, double left, double right, bint known, double strides, double dt) noexcept nogil:
    """Return whether a leg leads the other by unusually much, or did so in its last strides.

    left, right : phases; known : whether both are; strides : after which a stumble has ended; dt : s
    """
    cdef double difference = left - right - m[USUAL]
    cdef double phase, mean
    cdef int side
    difference -= floor(difference + 0.5)
    if known:
        m[SUM] += difference
        m[SQUARES_SUM] += difference * difference
        m[COUNT] += 1.0
        if fabs(difference) > clip(STUMBLE_TIMES * sqrt(m[SPREAD]), STUMBLE_LEAST, STUMBLE_MOST):
            m[STUMBLED] = m[STUMBLED + 1] = strides
    else:
        m[SUM] = m[SQUARES_SUM] = m[COUNT] = 0.0
        m[SPREAD] = max(m[SPREAD], FIRST_SPREAD)
    for side in range(2):
        phase = right if side else left
        phase -= floor(phase)
        if m[BEFORE + side] - phase > 0.5:
            if side == 0 and m[COUNT] * dt >= LEARNED_TIME:
                # A stride without a stumble is learned; after one, both legs may be apart by another phase.
                mean = m[SUM] / m[COUNT]
                m[USUAL] += (1.0 if m[STUMBLED] > 0.0 else USUAL_SHARE) * mean
                if m[STUMBLED] == 0.0:
                    m[SPREAD] += USUAL_SHARE * (m[SQUARES_SUM] / m[COUNT] - m[SPREAD])
            if side == 0:
                m[SUM] = m[SQUARES_SUM] = m[COUNT] = 0.0
            m[STUMBLED + side] = max(0.0, m[STUMBLED + side] - 1.0)
        m[BEFORE + side] = phase
    return m[STUMBLED] + m[STUMBLED + 1] > 0.0


cdef int state_kernel(double *arena, const State *at, const State *sizes) noexcept nogil:
    cdef double phases = arena[at.left_phase] - arena[at.right_phase]
    cdef double flags = arena[at.left_walking] + arena[at.right_walking]
    cdef double left = arena[at.left_velocity]
    cdef double right = arena[at.right_velocity]
    cdef double *track = arena + at.track
    cdef double apart, share, fastest, still
    cdef bint ahead, steady
    if not is_finite(phases + flags + left + right) or isinf(arena[at.direction.left_shank_velocity]) \
            or isinf(arena[at.direction.right_shank_velocity]):
        arena[at.state] = arena[at.walking] = arena[at.standing] = 0.0
        arena[at.confidence] = arena[at.direction.direction] = NAN
        return OK
    # 1. Standing: neither leg has moved for a while, by the measure of a wearer who walks slowly.
    fastest = max(fabs(left), fabs(right))
    if flags == 2.0:
        track[FASTEST] = max(fastest, track[FASTEST] - track[FASTEST] * min(1.0, arena[DT] / PEAK_TIME))
    still = arena[at.still_velocity]
    track[SLOW] = track[SLOW] + arena[DT] if fastest < still else 0.0
    if track[FASTEST] > 0.0:
        still = max(STILL_FLOOR * still, min(still, STILL_SHARE * track[FASTEST]))
    track[STILL] = track[STILL] + arena[DT] if fastest < still else 0.0
    track[LEFT_STILL] = track[LEFT_STILL] + arena[DT] if fabs(left) < still else 0.0
    track[RIGHT_STILL] = track[RIGHT_STILL] + arena[DT] if fabs(right) < still else 0.0
    # 2. Walking: both legs walk forward, half a stride apart, without a stumble. Under a wearer who swings one leg, the
    #    other stands.
    ahead = forward(arena, &at.direction, arena[at.left_phase], left, right)
    steady = not stumbles(arena + at.apart, arena[at.left_phase], arena[at.right_phase], flags == 2.0, \
        2.0 if arena[at.direction.knees] != 0.0 else 1.0, arena[DT])       # knees alone show the direction less surely
    if max(track[LEFT_STILL], track[RIGHT_STILL]) >= PAUSE_TIME:
        flags = 0.0
    apart = phases - 0.5
    apart = fabs(apart - floor(apart + 0.5))
    share = min(1.0, arena[DT] / AGREEMENT_TIME)
    if flags < 2.0:
        apart = 0.5
    track[APART] += share * (apart - track[APART])
    arena[at.standing] = track[STILL] >= arena[at.still_time] - 0.5 * arena[DT] or track[SLOW] >= STEP_TIME
    if arena[at.standing] != 0.0:
        forget(arena + at.direction.evidence, track[STILL] >= DISCARD_TIME or track[SLOW] >= STEP_TIME)
    arena[at.walking] = arena[at.standing] == 0.0 and flags == 2.0 and ahead and steady \
        and track[APART] < arena[at.tolerance]
    arena[at.state] = 2.0 * arena[at.walking] + arena[at.standing]
    arena[at.confidence] = 1.0 if arena[at.standing] != 0.0 else max(0.0, 1.0 - track[APART] / arena[at.tolerance]) \
        if flags == 2.0 and ahead and steady else 0.0
    return OK


cdef struct Envelope:
    int32_t phase, u, walking, inside, deviation, deviations, smallest, strides, outside_time, recovery
    int32_t means, variances, counts
    int32_t track               # see below

ENVELOPE = items((<Envelope *>ITEMS)[0], "means[50] variances[50] counts[50] track[8]")

cdef enum:
    BINS = 50
    OUTSIDE = 0                 # s
    INSIDE = 1                  # s
    LEFT = 2                    # 1 after the envelope was left
    BIN = 3                     # last one
    EXPECTED = 4                # phase that the cadence predicts
    LATEST = 5                  # phase one tick before
    SINCE = 6                   # s since the stride began
    STRIDE = 7                  # s, duration of the last stride, 0 while unknown


cdef int envelope_kernel(double *arena, const Envelope *at, const Envelope *sizes) noexcept nogil:
    cdef double phase = arena[at.phase]
    cdef double u = arena[at.u]
    cdef double walking = arena[at.walking]
    cdef double *mean = arena + at.means
    cdef double *variance = arena + at.variances
    cdef double *count = arena + at.counts
    cdef double *m = arena + at.track
    cdef double x, share, expected, spread, difference
    cdef int i, j
    if not is_finite(phase + u) or walking != walking:
        arena[at.inside] = 0.0
        arena[at.deviation] = NAN
        return OK
    phase -= floor(phase)
    arena[at.deviation] = 0.0
    if walking == 0.0:
        m[OUTSIDE] = m[INSIDE] = m[LEFT] = m[STRIDE] = 0.0
        m[SINCE] = INFINITY
        arena[at.inside] = 1.0
        return OK
    # 1. The phase that the last stride predicts, which follows the estimate within part of a stride: an estimate that
    #    follows the angle would hide where the angle deviates.
    m[SINCE] += arena[DT]
    if m[LATEST] - phase > 0.5:
        m[STRIDE] = m[SINCE] if is_finite(m[SINCE]) else 0.0
        m[SINCE] = 0.0
    m[LATEST] = phase
    if m[STRIDE] > 0.0:
        share = arena[DT] / m[STRIDE]
        m[EXPECTED] += share
        x = phase - m[EXPECTED]
        m[EXPECTED] += min(1.0, share / FOLLOWING_SHARE) * (x - floor(x + 0.5))
    else:
        m[EXPECTED] = phase
    x = BINS * (m[EXPECTED] - floor(m[EXPECTED]))
    i = min(<int>x, BINS - 1)
    j = (i + 1) % BINS
    share = x - i
    if count[i] >= arena[at.strides] and count[j] >= arena[at.strides]:
        # 2. Deviation from the mean stride, over the half width of the envelope.
        expected = (1.0 - share) * mean[i] + share * mean[j]
        spread = sqrt((1.0 - share) * variance[i] + share * variance[j])
        arena[at.deviation] = (u - expected) / max(arena[at.deviations] * spread, arena[at.smallest])
    if fabs(arena[at.deviation]) > 1.0:
        m[OUTSIDE] += arena[DT]
        m[INSIDE] = 0.0
        if m[OUTSIDE] >= arena[at.outside_time] - 0.5 * arena[DT]:
            m[LEFT] = 1.0
    else:
        m[OUTSIDE] = 0.0
        m[INSIDE] += arena[DT]
        if m[INSIDE] >= arena[at.recovery]:
            m[LEFT] = 0.0
    arena[at.inside] = m[LEFT] == 0.0
    # 3. Strides inside enter the envelope, one sample a bin, at its begin.
    if i != <int>m[BIN]:
        m[BIN] = i
        if m[LEFT] == 0.0:
            difference = u - mean[i]
            count[i] += 1.0
            share = max(1.0 / count[i], 0.05)
            mean[i] += share * difference
            variance[i] = (1.0 - share) * (variance[i] + share * difference * difference)
    return OK


cdef struct Gate:
    int32_t u, enable, velocity, uncertainty, y, fade_in, fade_out, damping, limit, certain, uncertain
    int32_t mode                # 0 zero, 1 damping, 2 hold
    int32_t track               # share that passes, held torque

GATE = items((<Gate *>ITEMS)[0], "track[2]")


cdef int gate_kernel(double *arena, const Gate *at, const Gate *sizes) noexcept nogil:
    cdef double u = arena[at.u]
    cdef double enable = arena[at.enable]
    cdef double velocity = arena[at.velocity]
    cdef double uncertainty = arena[at.uncertainty]
    cdef double *m = arena + at.track
    cdef double rest = 0.0
    cdef double share = 0.0
    if not is_finite(u) or not is_finite(velocity) or not is_finite(uncertainty) or enable != enable:
        arena[at.y] = NAN
        return OK
    if enable != 0.0:
        share = clip((arena[at.uncertain] - uncertainty) / (arena[at.uncertain] - arena[at.certain]), 0.0, 1.0)
    if m[0] < share:
        m[0] = min(share, m[0] + arena[DT] / arena[at.fade_in])
    else:
        m[0] = max(share, m[0] - arena[DT] / arena[at.fade_out])
    if arena[at.mode] == 1.0:
        rest = clip(-arena[at.damping] * velocity, -arena[at.limit], arena[at.limit])
    elif arena[at.mode] == 2.0:
        if enable != 0.0:
            m[1] = u
        rest = m[1]
    arena[at.y] = clip(m[0] * u + (1.0 - m[0]) * rest, min(u, rest), max(u, rest))     # also without rounding beyond
    return OK


gait_state = export(<kernel_t>state_kernel, STATE)
stride_envelope = export(<kernel_t>envelope_kernel, ENVELOPE)
torque_gate = export(<kernel_t>gate_kernel, GATE)
