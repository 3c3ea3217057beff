# cython: freethreading_compatible=True
"""Sensors of the legs that are exchanged, upside down or turned."""

from libc.math cimport NAN, fabs, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, FIRST_OWN_STATUS, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport is_finite

cdef enum:                              # statuses
    EXCHANGED = FIRST_OWN_STATUS
    LEFT_REVERSED = FIRST_OWN_STATUS + 1
    RIGHT_REVERSED = FIRST_OWN_STATUS + 2
    LEFT_STILL = FIRST_OWN_STATUS + 3
    RIGHT_STILL = FIRST_OWN_STATUS + 4

cdef double USUAL_STRIDE = 1.1          # s; longer ones lengthen all times but the last in proportion,
cdef double LONGEST_STRIDE = 3.0        # s, up to this
cdef double MEAN_TIME = 0.6             # s, time constant of all means
cdef double MOVING = 0.3                # standard deviation of the reference, left less right, from which legs move
cdef double MOVED_TIME = 0.6            # s of motion before the first comparison
cdef double RESUME_TIME = 1.0           # s of walking after a pause before the next comparison
cdef double LEAD_SHARE = 0.5            # of the standard deviation of the reference, left less right, beyond its mean
cdef double COMPARED_TIME = 0.5         # s of comparison from which only samples of walking count
cdef double FAULT_TIME = 0.2            # s of disagreement that are a fault,
cdef double OWN_FAULT_TIME = 0.4        # and of one leg alone: the first steps and a turn move the legs unlike
cdef double REVERSED_LIMIT = -0.3       # correlation of a sensor with its reference
cdef double FOLLOWING_LIMIT = 0.3       # the same, above which it follows its reference
cdef double STILL_SHARE = 0.06          # of the variance of the other leg's sensor,
cdef double MOVING_SHARE = 0.25         # while its reference has this share


cdef struct Placement:
    int32_t left_reference, right_reference, left, right, enable, agreement
    int32_t sign                # -1 if sensor and reference move in opposite directions
    int32_t least               # agreement below which sensors are exchanged
    int32_t averaging           # s of comparison over which the agreement is averaged; 0 for none
    int32_t moments             # see below

PLACEMENT = items((<Placement *>ITEMS)[0], "moments[23]")

cdef enum:
    Q = 0                       # means of both references,
    X = 2                       # of both sensors,
    QQ = 4                      # and of products: reference and sensor with themselves,
    XX = 6
    OWN = 8                     # reference with the sensor of its leg,
    CROSS = 10                  # and with that of the other leg
    Q_BOTH = 12                 # both references, and both sensors
    X_BOTH = 13
    MOVED = 14                  # s of motion
    WRONG = 15                  # s of disagreement
    COMPARED = 16               # s of comparison,
    RESUMED = 17                # and since a pause, in usual strides
    AHEAD = 18                  # 1 while the left reference is ahead of the right one
    LAST_STRIDE = 19            # s between the last two times at which it came ahead,
    SINCE_AHEAD = 20            # and since the last one, 0 without it
    JUDGED = 21                 # s over which the agreement was averaged,
    AVERAGE = 22                # and its average


cdef inline double correlation(double covariance, double one, double other) noexcept nogil:
    """Return the correlation from a covariance and two variances, 0 where one is constant."""
    return covariance / sqrt(one * other) if one > 0.0 and other > 0.0 else 0.0


cdef inline double stride_time(double *state, double ahead, double least, double dt) noexcept nogil:
    """Return the duration of the present stride so far, or of the last one if that is longer, in s.

    state : 1 while ahead, s of the last stride, and s of the present one, 0 while unknown; ahead : by how much a signal
    is above its mean; least : amount that counts; dt : s of motion since the last tick
    """
    if state[2] > 0.0:
        state[2] += dt
    if ahead < -least:
        state[0] = 0.0
    elif ahead > least and state[0] == 0.0:
        if state[2] > 0.0:
            state[1] = state[2]
        state[0] = 1.0
        state[2] = dt
    return max(state[1], state[2])


cdef inline bint pauses(double enable, double dt, double *compared, double *resumed) noexcept nogil:
    """Return whether the comparison is suspended again: a stand and the step that ends it do not count.

    compared : s of comparison; resumed : negative until the comparison may go on
    """
    if enable == 0.0 and compared[0] > COMPARED_TIME:
        resumed[0] = -RESUME_TIME
        return True
    if enable != 0.0:
        compared[0] += dt
        resumed[0] += dt
    return False


cdef int placement_kernel(double *arena, const Placement *at, const Placement *sizes) noexcept nogil:
    cdef double *m = arena + at.moments
    cdef double q[2]
    cdef double x[2]
    cdef double own[2]
    cdef double vq[2]
    cdef double vx[2]
    cdef double slow, share, c, spread_q, spread_x, agreement
    cdef int i, k
    cdef int status = OK
    q[0] = arena[at.left_reference]
    q[1] = arena[at.right_reference]
    x[0] = arena[at.sign] * arena[at.left]
    x[1] = arena[at.sign] * arena[at.right]
    if not is_finite(q[0] + q[1] + x[0] + x[1]) or arena[at.enable] != arena[at.enable]:
        arena[at.agreement] = NAN
        return OK
    slow = max(1.0, min(LONGEST_STRIDE, max(m[LAST_STRIDE], m[SINCE_AHEAD])) / USUAL_STRIDE)
    if pauses(arena[at.enable], arena[DT] / slow, m + COMPARED, m + RESUMED):
        m[WRONG] = m[SINCE_AHEAD] = 0.0
        return OK
    share = min(1.0, arena[DT] / (MEAN_TIME * slow))
    # 1. Moments of references and sensors.
    for i in range(2):
        k = 1 - i
        m[Q + i] += share * (q[i] - m[Q + i])
        m[X + i] += share * (x[i] - m[X + i])
        m[QQ + i] += share * (q[i] * q[i] - m[QQ + i])
        m[XX + i] += share * (x[i] * x[i] - m[XX + i])
        m[OWN + i] += share * (q[i] * x[i] - m[OWN + i])
        m[CROSS + i] += share * (q[i] * x[k] - m[CROSS + i])
    m[Q_BOTH] += share * (q[0] * q[1] - m[Q_BOTH])
    m[X_BOTH] += share * (x[0] * x[1] - m[X_BOTH])
    for i in range(2):
        vq[i] = m[QQ + i] - m[Q + i] * m[Q + i]
        vx[i] = m[XX + i] - m[X + i] * m[X + i]
    # 2. The difference between the legs: that of the sensors follows that of the references.
    spread_q = vq[0] + vq[1] - 2.0 * (m[Q_BOTH] - m[Q] * m[Q + 1])
    spread_x = vx[0] + vx[1] - 2.0 * (m[X_BOTH] - m[X] * m[X + 1])
    c = 0.0
    for i in range(2):
        own[i] = m[OWN + i] - m[Q + i] * m[X + i]
        c += own[i] - m[CROSS + i] + m[Q + i] * m[X + 1 - i]
    agreement = correlation(c, spread_q, spread_x)
    arena[at.agreement] = agreement
    stride_time(m + AHEAD, q[0] - q[1] - m[Q] + m[Q + 1], LEAD_SHARE * sqrt(max(0.0, spread_q)), arena[DT])
    if spread_q > MOVING * MOVING:
        m[MOVED] += arena[DT] / slow
    else:
        m[MOVED] = m[SINCE_AHEAD] = 0.0
    if m[MOVED] < MOVED_TIME or arena[at.enable] == 0.0 or m[RESUMED] < 0.0:
        m[WRONG] = 0.0
        return OK
    for i in range(2):
        own[i] = correlation(own[i], vq[i], vx[i])
    # 3. Exchanged sensors disagree on both legs, a reversed one on its own; a turned one hardly moves.
    if arena[at.averaging] > 0.0:
        m[JUDGED] += arena[DT] / slow
        m[AVERAGE] += (agreement - m[AVERAGE]) * arena[DT] / (slow * min(m[JUDGED], arena[at.averaging]))
        if m[AVERAGE] < arena[at.least]:
            status = EXCHANGED
    elif agreement < arena[at.least] and max(own[0], own[1]) < max(arena[at.least], FOLLOWING_LIMIT):
        status = EXCHANGED
    else:
        for i in range(2):
            if status == OK and vx[i] < STILL_SHARE * vx[1 - i] and vq[i] > MOVING_SHARE * vq[1 - i]:
                status = RIGHT_STILL if i else LEFT_STILL
            elif status == OK and own[i] < REVERSED_LIMIT:
                status = RIGHT_REVERSED if i else LEFT_REVERSED
    m[WRONG] = m[WRONG] + arena[DT] / slow if status != OK else 0.0
    return status if m[WRONG] > (FAULT_TIME if status == EXCHANGED else OWN_FAULT_TIME) else OK


cdef enum:                              # statuses
    LEFT_ORDER = FIRST_OWN_STATUS
    RIGHT_ORDER = FIRST_OWN_STATUS + 1

cdef double ORDER_TIME = 1.0            # s, time constant of the variances
cdef double STILL_RATE = 0.3            # rad/s of every segment, below which the wearer stands
cdef double TURNED_TIME = 1.25          # s of motion, from which a leg may have swung
cdef double SWUNG_SHARE = 0.25          # of the largest variance of the other leg, from which a leg has swung


cdef struct Order:
    int32_t left_upper, right_upper, left_lower, right_lower, enable, least
    int32_t moments             # means, then mean squares, of the inputs in their order; then see below

ORDER = items((<Order *>ITEMS)[0], "moments[12]")

cdef enum:
    DISORDER = 8                # s of the wrong order,
    ORDERS = 9                  # of comparison,
    ONWARD = 10                 # and since a pause
    TURNED = 11                 # s of motion


cdef int order_kernel(double *arena, const Order *at, const Order *sizes) noexcept nogil:
    cdef double *m = arena + at.moments
    cdef double x[4]
    cdef double variances[4]
    cdef double share = min(1.0, arena[DT] / ORDER_TIME)
    cdef int i
    cdef int status = OK
    x[0] = arena[at.left_upper]
    x[1] = arena[at.right_upper]
    x[2] = arena[at.left_lower]
    x[3] = arena[at.right_lower]
    if not is_finite(x[0] + x[1] + x[2] + x[3]) or arena[at.enable] != arena[at.enable]:
        return OK
    if pauses(arena[at.enable], arena[DT], m + ORDERS, m + ONWARD):
        m[DISORDER] = 0.0
        return OK
    # A stand does not count: the step that ends it turns one thigh alone.
    if max(fabs(x[0]), fabs(x[1]), fabs(x[2]), fabs(x[3])) < STILL_RATE:
        share = 0.0
    else:
        m[TURNED] += arena[DT]
    for i in range(4):
        m[i] += share * (x[i] - m[i])
        m[4 + i] += share * (x[i] * x[i] - m[4 + i])
        variances[i] = m[4 + i] - m[i] * m[i]
    # Above a foot that only pivots, as in a turn, the shank turns faster.
    for i in range(2):
        if status == OK and variances[2 + i] < arena[at.least] * variances[i] \
                and max(variances[i], variances[2 + i]) >= SWUNG_SHARE * max(variances[1 - i], variances[3 - i]):
            status = RIGHT_ORDER if i else LEFT_ORDER
    m[DISORDER] = m[DISORDER] + arena[DT] if status != OK and arena[at.enable] != 0.0 and m[ONWARD] >= 0.0 \
        and m[TURNED] >= TURNED_TIME else 0.0
    return status if m[DISORDER] > FAULT_TIME else OK


cdef enum:                              # statuses
    LEFT_POSTURE = FIRST_OWN_STATUS
    RIGHT_POSTURE = FIRST_OWN_STATUS + 1
    LEFT_TURNED = FIRST_OWN_STATUS + 2
    RIGHT_TURNED = FIRST_OWN_STATUS + 3
    LEFT_SLIPPED = FIRST_OWN_STATUS + 4
    RIGHT_SLIPPED = FIRST_OWN_STATUS + 5

cdef double POSTURE_TIME = 0.6          # s, time constant of both stages of the means in usual strides
cdef double MEAN_AFTER = 3.0            # s of samples from which they are compared,
cdef double MEAN_STRIDES = 2.3          # and strides
cdef double CROSSING = 0.05             # rad, by which a pitch leaves its mean before it counts as above or below it
cdef double STAND_AFTER = 1.0           # s of samples from which a stand does not count
cdef double POSTURE_PAUSE = 0.3         # s of a pause, after which the means start again
cdef double SLIP_TIME = 1.0             # s of a changed posture that are a fault; a turn and a stop are shorter
cdef double USUAL_TIME = 30.0           # s, time constant of the usual posture
cdef double USUAL_AFTER = 5.0           # s of walking from which it is known


cdef struct Posture:
    int32_t left, right, enable, lowest, highest, difference, slip
    int32_t means               # see below

POSTURE = items((<Posture *>ITEMS)[0], "means[19]")

cdef enum:
    STAGE = 0                   # first stage of the means of left and right,
    MEAN = 2                    # second stage,
    USUAL = 4                   # and their means in walking
    TIME = 6                    # s of samples without a pause
    WALKED = 7                  # s of walking
    ASTRAY = 8                  # s of a wrong posture, less s of a right one
    POSTURES = 9                # s of comparison,
    PAUSE = 10                  # and of a pause
    BEFORE = 11                 # left and right, one tick before
    LEFT_STRIDE = 13            # see `stride_time`, of the left pitch about its mean,
    RIGHT_STRIDE = 16           # and of the right one


cdef int posture_kernel(double *arena, const Posture *at, const Posture *sizes) noexcept nogil:
    cdef double *m = arena + at.means
    cdef double x[2]
    cdef double moved[2]
    cdef double *state
    cdef double share, difference, slow, fault_time
    cdef double stride = 0.0
    cdef bint unmeasured = False
    cdef double dt = arena[DT]
    cdef double centre = 0.5 * (arena[at.lowest] + arena[at.highest])
    cdef int i
    cdef int status = OK
    x[0] = arena[at.left]
    x[1] = arena[at.right]
    if not is_finite(x[0] + x[1]) or arena[at.enable] != arena[at.enable]:
        return OK
    if arena[at.enable] != 0.0:
        m[POSTURES] += dt
        m[PAUSE] = 0.0
    elif m[POSTURES] > COMPARED_TIME:
        m[PAUSE] += dt
        if m[PAUSE] >= POSTURE_PAUSE:
            m[TIME] = m[ASTRAY] = m[LEFT_STRIDE + 2] = m[RIGHT_STRIDE + 2] = 0.0
        return OK
    # 1. Means of two stages, which weigh the first samples alike, and hardly contain the motion within a stride.
    m[TIME] += dt
    # A stand does not count once the legs have moved: it may end with one leg before the other.
    if m[TIME] > STAND_AFTER and max(fabs(x[0] - m[BEFORE]), fabs(x[1] - m[BEFORE + 1])) < STILL_RATE * dt:
        dt = 0.0
    for i in range(2):
        state = m + (RIGHT_STRIDE if i else LEFT_STRIDE)
        stride = max(stride, stride_time(state, x[i] - m[MEAN + i], CROSSING, dt))
        unmeasured |= state[1] == 0.0 and 0.0 < state[2] < LONGEST_STRIDE
    stride = min(LONGEST_STRIDE, stride)
    slow = max(1.0, stride / USUAL_STRIDE)
    share = dt / min(m[TIME], POSTURE_TIME * slow)
    for i in range(2):
        m[BEFORE + i] = x[i]
        m[STAGE + i] += share * (x[i] - m[STAGE + i])
        m[MEAN + i] += share * (m[STAGE + i] - m[MEAN + i])
    if arena[at.enable] == 0.0 or unmeasured or m[TIME] < max(MEAN_AFTER, MEAN_STRIDES * stride):
        return OK
    # 2. The usual posture in walking.
    m[WALKED] += arena[DT]
    share = arena[DT] / min(m[WALKED], USUAL_TIME)
    for i in range(2):
        m[USUAL + i] += share * (m[MEAN + i] - m[USUAL + i])
        moved[i] = m[MEAN + i] - m[USUAL + i]
    # 3. One sensor has slipped, differs from that of the other leg, or both are turned: at once if this is usual.
    fault_time = FAULT_TIME if fabs(m[USUAL] - m[USUAL + 1]) > arena[at.difference] else SLIP_TIME
    difference = m[MEAN] - m[MEAN + 1]
    if m[WALKED] > USUAL_AFTER and fabs(moved[0] - moved[1]) > arena[at.slip]:
        status = RIGHT_SLIPPED if fabs(moved[1]) > fabs(moved[0]) else LEFT_SLIPPED
    elif fabs(difference) > arena[at.difference]:
        status = RIGHT_TURNED if fabs(m[MEAN + 1] - centre) > fabs(m[MEAN] - centre) else LEFT_TURNED
    for i in range(2):
        if not arena[at.lowest] <= m[USUAL + i] <= arena[at.highest]:
            fault_time = FAULT_TIME
        if status == OK and not arena[at.lowest] <= m[MEAN + i] <= arena[at.highest]:
            status = RIGHT_POSTURE if i else LEFT_POSTURE
    m[ASTRAY] = max(0.0, m[ASTRAY] + (arena[DT] if status != OK else -arena[DT]) / slow)
    return status if m[ASTRAY] > (SLIP_TIME if status >= LEFT_SLIPPED else fault_time) else OK


segment_order = export(<kernel_t>order_kernel, ORDER)
segment_posture = export(<kernel_t>posture_kernel, POSTURE)
placement = export(<kernel_t>placement_kernel, PLACEMENT)
