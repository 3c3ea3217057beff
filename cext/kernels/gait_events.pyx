# cython: freethreading_compatible=True
"""Detectors of heel strike."""

from libc.math cimport INFINITY, NAN, fabs
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport is_finite

cdef enum:
    MEDIAN_COUNT = 9

cdef double SWING_SHARE = 0.7           # of the typical height, that a rise needs to be a swing
cdef double STRIDE_LIMIT = 3.0          # s, longer intervals contain a stop
cdef double RANGE_DECAY_TIME = 5.0      # s, time constant with which an adaptive range shrinks
cdef double SHRINK_AFTER = 2.0          # s without an event
cdef double LATE_SHARE = 1.2            # of a stride without a strike
cdef double SLIP_SHARE = 0.5            # of the range, that a leg of which the sensor has slipped moves over
cdef double RELEASE_TIME = 0.05         # s below the threshold that end a contact
cdef double SWING_TIME = 0.1            # s without contact before the next strike,
cdef double FREE_SHARE = 0.6            # or so much of the usual time without contact,
cdef double FREE_LIMIT = 0.5            # which counts up to this share of a stride
cdef double WINDOW = 1.5                # s, half of the time over which the load range is measured
cdef double STANCE_LOAD = 0.4           # load that a contact reaches if the foot bears the body
cdef double JUMP_LOAD = 0.5             # rise of the load within a sample that the next sample must confirm,
cdef double EXPECTED_SHARE = 0.8        # in this share of a stride after a strike
cdef double EXTENSION_RATE_LIMIT = 3.5  # smallest rate of the extension after swing, heights per time between swings
cdef double LANDING_WIDTH = 0.005       # of a stride, between two points of the mean velocity after the extension
cdef double LEARNED_LANDINGS = 10.0     # strides of that mean,
cdef double FEWEST_LANDINGS = 3.0       # from which on it determines the lead,
cdef double LANDING_SHARE = 0.2         # of the largest deceleration, at which a minimum is its end
cdef double SHORTEST_LEAD = 0.03        # within these limits
cdef double LONGEST_LEAD = 0.085


cdef struct Events:
    int32_t strike, strides, elapsed, shortest
    int32_t timing              # see below

cdef enum:
    SINCE = 0                   # s since the last strike
    STRIDE = 1                  # s, last stride
    DUE = 2                     # s until the strike; infinite without a pending one
    COUNT = 3                   # strikes since the start


cdef inline double middle(double *latest, double x) noexcept nogil:
    """Store x and return the median of the last three samples: a single outlier has no effect."""
    cdef double a = latest[0]
    cdef double b = latest[1]
    latest[0] = b
    latest[1] = x
    if not is_finite(a):
        return x
    return max(min(a, b), min(max(a, b), x))


cdef inline int finish(double *arena, const Events *at, bint missing) noexcept nogil:
    """Advance the time, report a strike that is due, at the next sample if this one is missing; write the outputs."""
    cdef double *timing = arena + at.timing
    cdef bint strike = False
    timing[SINCE] += arena[DT]
    if timing[DUE] <= 0.5 * arena[DT] and not missing:
        timing[DUE] = INFINITY
        if timing[SINCE] >= arena[at.shortest]:
            # A much longer interval may contain a stop: it changes the stride by a tenth.
            if timing[SINCE] <= STRIDE_LIMIT:
                timing[STRIDE] = timing[SINCE] if timing[SINCE] <= 1.6 * timing[STRIDE] else 1.1 * timing[STRIDE]
            strike = True
            timing[SINCE] = 0.0
            timing[COUNT] += 1.0
    else:
        timing[DUE] -= arena[DT]
    arena[at.strike] = NAN if missing else strike
    arena[at.strides] = timing[COUNT]
    arena[at.elapsed] = NAN if missing else timing[SINCE]
    return OK


# Contact

cdef struct Contact:
    Events events
    int32_t force, contact, load, rising, falling, smallest
    int32_t recent              # the last samples, oldest overwritten first
    int32_t window              # see below
    int32_t state               # see below

CONTACT = items((<Contact *>ITEMS)[0], "timing[4] recent[9] window[9] state[6]")

cdef enum:
    LOADED = 0                  # 1 in contact
    BELOW = 1                   # s below the falling threshold
    FREE = 2                    # s without contact
    LARGEST = 3                 # load of the last contact; infinite before the first
    BEFORE_LOAD = 4             # load one sample before
    USUAL_FREE = 5              # s, longest recent time without contact

cdef enum:
    ZERO = 0
    PEAK = 1
    WINDOW_TIME = 2
    WINDOW_LOW = 3
    WINDOW_HIGH = 4
    OLD_LOW = 5                 # of the window before
    OLD_HIGH = 6
    FILLED = 7                  # samples in `recent`
    LOST = 8                    # s since the last sample that was not lost


cdef inline double median(double *recent, double *filled, double x) noexcept nogil:
    """Store x and return the median of the last samples: drop-outs shift neither zero nor peak."""
    cdef double ordered[MEDIAN_COUNT]
    cdef int n = <int>filled[0]
    cdef int i, j
    for i in range(MEDIAN_COUNT - 1):
        recent[i] = recent[i + 1]
    recent[MEDIAN_COUNT - 1] = x
    if n < MEDIAN_COUNT:
        n += 1
        filled[0] = n
    for i in range(n):
        x = recent[MEDIAN_COUNT - n + i]
        j = i
        while j > 0 and ordered[j - 1] > x:
            ordered[j] = ordered[j - 1]
            j -= 1
        ordered[j] = x
    return ordered[n // 2]


cdef int contact_kernel(double *arena, const Contact *at, const Contact *sizes) noexcept nogil:
    cdef double force = arena[at.force]
    cdef double *timing = arena + at.events.timing
    cdef double *w = arena + at.window
    cdef double *state = arena + at.state
    cdef double smooth, low, high, span, level
    cdef bint expected, swing
    if not is_finite(force):
        arena[at.contact] = NAN
        arena[at.load] = NAN
        return finish(arena, &at.events, True)
    # 1. A lost sample reads 0, which is implausible for a moment where the zero of the sensor is elsewhere.
    if force == 0.0 and w[PEAK] > w[ZERO] and fabs(w[ZERO]) > 0.05 * (w[PEAK] - w[ZERO]) and w[LOST] < RELEASE_TIME:
        force = (arena + at.recent)[MEDIAN_COUNT - 1]
        w[LOST] += arena[DT]
    elif force != 0.0:
        w[LOST] = 0.0
    # 2. Zero and peak: extremes of the last one to two windows. A window without a step, as in standing, is left out.
    smooth = median(arena + at.recent, w + FILLED, force)
    w[WINDOW_LOW] = min(w[WINDOW_LOW], smooth)
    w[WINDOW_HIGH] = max(w[WINDOW_HIGH], smooth)
    w[WINDOW_TIME] += arena[DT]
    low = min(w[WINDOW_LOW], w[OLD_LOW])
    high = max(w[WINDOW_HIGH], w[OLD_HIGH])
    if high - low >= max(arena[at.smallest], 0.3 * (w[PEAK] - w[ZERO])):
        w[ZERO] = low
        w[PEAK] = high
    else:
        w[ZERO] = min(w[ZERO], low)
    if w[WINDOW_TIME] >= WINDOW:
        w[WINDOW_TIME] = 0.0
        if w[WINDOW_HIGH] - w[WINDOW_LOW] >= max(arena[at.smallest], 0.3 * (w[PEAK] - w[ZERO])):
            w[OLD_LOW] = w[WINDOW_LOW]
            w[OLD_HIGH] = w[WINDOW_HIGH]
        w[WINDOW_LOW] = INFINITY
        w[WINDOW_HIGH] = -INFINITY
    # 3. Contact begins at once and ends after RELEASE_TIME, so that a drop-out does not end it.
    state[USUAL_FREE] -= state[USUAL_FREE] * arena[DT] / RANGE_DECAY_TIME
    span = max(w[PEAK] - w[ZERO], arena[at.smallest]) if is_finite(w[ZERO] + w[PEAK]) else INFINITY
    level = (force - w[ZERO]) / span if is_finite(span) else 0.0
    if state[LOADED] != 0.0:
        state[LARGEST] = max(state[LARGEST], level)
        state[BELOW] = state[BELOW] + arena[DT] if level < arena[at.falling] else 0.0
        if state[BELOW] >= RELEASE_TIME:
            state[LOADED] = 0.0
            state[FREE] = state[BELOW]
    else:
        state[FREE] += arena[DT]
        expected = timing[SINCE] > EXPECTED_SHARE * timing[STRIDE]
        if level > arena[at.rising] and (expected or level - state[BEFORE_LOAD] < JUMP_LOAD):
            # Without a swing before it, a contact continues the last one: a heel can press again before it leaves.
            swing = state[FREE] >= max(SWING_TIME, FREE_SHARE * state[USUAL_FREE])
            state[USUAL_FREE] = max(state[USUAL_FREE], min(state[FREE], FREE_LIMIT * timing[STRIDE]))
            if swing and timing[SINCE] + arena[DT] >= arena[at.events.shortest]:
                # A foot that hardly bore load, such as one that touches the ground while its owner sits, did not step.
                if state[LARGEST] >= STANCE_LOAD:
                    timing[DUE] = 0.0
                state[LARGEST] = 0.0
            state[LOADED] = 1.0
            state[BELOW] = 0.0
            state[LARGEST] = max(state[LARGEST], level)
    state[BEFORE_LOAD] = level
    arena[at.contact] = state[LOADED]
    arena[at.load] = level
    return finish(arena, &at.events, False)


# Thigh

cdef struct Thigh:
    Events events
    int32_t angle, lead, smallest
    int32_t extremes            # see below
    int32_t latest              # the last two samples

THIGH = items((<Thigh *>ITEMS)[0], "timing[4] extremes[6] latest[2]")

cdef enum:
    LOW = 0                     # in use
    HIGH = 1
    NEW_LOW = 2                 # since the last event
    NEW_HIGH = 3
    ARMED = 4                   # 1 after the angle was in the lower part of its range
    NEW_TIME = 5                # s over which the new range was measured


cdef int thigh_kernel(double *arena, const Thigh *at, const Thigh *sizes) noexcept nogil:
    cdef double *timing = arena + at.events.timing
    cdef double *e = arena + at.extremes
    cdef double angle = arena[at.angle]
    cdef double shrink, level
    if not is_finite(angle):
        return finish(arena, &at.events, True)
    angle = middle(arena + at.latest, angle)
    # 1. The range grows at once; each event moves it to the range since the one before, and without events it shrinks.
    e[NEW_LOW] = min(e[NEW_LOW], angle)
    e[NEW_HIGH] = max(e[NEW_HIGH], angle)
    e[NEW_TIME] += arena[DT]
    if timing[SINCE] > LATE_SHARE * timing[STRIDE] and e[NEW_TIME] > LATE_SHARE * timing[STRIDE]:
        # A strike is overdue: if the leg moves, its sensor has slipped, and the range is that since then.
        if e[NEW_HIGH] - e[NEW_LOW] > max(arena[at.smallest], SLIP_SHARE * (e[HIGH] - e[LOW])):
            e[LOW] = e[NEW_LOW]
            e[HIGH] = e[NEW_HIGH]
        e[NEW_LOW] = e[NEW_HIGH] = angle
        e[NEW_TIME] = 0.0
    if e[HIGH] > e[LOW] and timing[SINCE] > SHRINK_AFTER:
        shrink = 0.5 * (e[HIGH] - e[LOW]) * min(1.0, arena[DT] / RANGE_DECAY_TIME)
        e[LOW] += shrink
        e[HIGH] -= shrink
    e[LOW] = min(e[LOW], angle)
    e[HIGH] = max(e[HIGH], angle)
    # 2. An event is the rise through a level, after the angle was low.
    level = (angle - e[LOW]) / max(e[HIGH] - e[LOW], arena[at.smallest])
    if level < 0.3:
        e[ARMED] = 1.0
    elif level > 0.7 and e[ARMED] != 0.0:
        e[ARMED] = 0.0
        timing[DUE] = arena[at.lead] * timing[STRIDE] - arena[DT]
        if e[NEW_HIGH] - e[NEW_LOW] > arena[at.smallest] and timing[COUNT] > 0.0:
            e[LOW] += 0.5 * (e[NEW_LOW] - e[LOW])
            e[HIGH] += 0.5 * (e[NEW_HIGH] - e[HIGH])
        e[NEW_LOW] = INFINITY
        e[NEW_HIGH] = -INFINITY
        e[NEW_TIME] = 0.0
    return finish(arena, &at.events, False)


# Knee

cdef struct Swing:
    int32_t angle, smallest
    int32_t turns               # see below

cdef enum:
    RISING = 0                  # 1 or -1
    EXTREME = 1                 # largest or smallest angle since the last turn
    AGE = 2                     # s since the extreme
    RANGE = 3                   # typical height of a swing
    BEFORE = 4                  # the extreme before
    HEIGHT = 5                  # of the last rise


cdef inline bint swing_peak(double *arena, const Swing *at, double angle, double reversal) noexcept nogil:
    """Follow the turning points of an angle. Return whether a maximum after a large rise was confirmed.

    reversal : change that confirms a turning point, as a fraction of the typical height
    """
    cdef double *t = arena + at.turns
    cdef double step
    t[AGE] += arena[DT]
    t[RANGE] -= t[RANGE] * arena[DT] / RANGE_DECAY_TIME
    if t[RANGE] < arena[at.smallest]:
        t[RANGE] = arena[at.smallest]
    step = reversal * t[RANGE]
    if not is_finite(t[EXTREME]):
        t[EXTREME] = t[BEFORE] = angle
        t[RISING] = 1.0
    if t[RISING] > 0.0:
        if angle >= t[EXTREME]:
            t[EXTREME] = angle
            t[AGE] = 0.0
        elif angle < t[EXTREME] - step:
            t[HEIGHT] = t[EXTREME] - t[BEFORE]
            t[BEFORE] = t[EXTREME]
            t[EXTREME] = angle
            t[RISING] = -1.0
            if t[HEIGHT] >= SWING_SHARE * t[RANGE]:
                t[RANGE] += (1.0 if t[HEIGHT] > t[RANGE] else 0.5) * (t[HEIGHT] - t[RANGE])
                return True
    elif angle <= t[EXTREME]:
        t[EXTREME] = angle
        t[AGE] = 0.0
    elif angle > t[EXTREME] + step:
        t[BEFORE] = t[EXTREME]
        t[EXTREME] = angle
        t[AGE] = 0.0
        t[RISING] = 1.0
    return False


cdef struct Knee:
    Events events
    Swing swing
    int32_t velocity, lead
    int32_t extension           # see below
    int32_t latest              # the last two angles and velocities
    int32_t landing             # see below

KNEE = items((<Knee *>ITEMS)[0], "timing[4] turns[6] extension[5] latest[4] landing[28]")

cdef enum:
    EXTENDING = 0               # 1 while the knee extends after swing
    EXTENSION_RATE = 1          # largest
    SWING_ANGLE = 2             # at the flexion in swing
    SINCE_SWING = 3             # s since the last flexion in swing
    SWING_PERIOD = 4            # s between the last two

cdef enum:
    LANDING_POINTS = 22
    SLOPE = 3                   # points before and after, of which the difference is the acceleration
    LANDING_TIME = 0            # s since the event
    LANDING_STRIDE = 1          # s, stride at the event
    POINT = 2                   # next one of this stride
    BEFORE_VELOCITY = 3         # one sample before
    LANDINGS = 4                # strides of the mean
    OWN_LEAD = 5                # of this leg, 0 while unknown
    MEANS = 6                   # mean velocity at each point


cdef inline void learn_landing(double *l, double velocity, double dt) noexcept nogil:
    """Enter the velocity after an event into the mean, and find the end of the deceleration of the extension in it."""
    cdef double *mean = l + MEANS
    cdef double width = LANDING_WIDTH * l[LANDING_STRIDE]
    cdef double value, acceleration
    cdef double before = INFINITY
    cdef double largest = 0.0
    cdef int j
    if l[POINT] >= LANDING_POINTS:
        return
    l[LANDING_TIME] += dt
    while l[POINT] < LANDING_POINTS and l[POINT] * width <= l[LANDING_TIME]:
        j = <int>l[POINT]
        value = velocity - (velocity - l[BEFORE_VELOCITY]) * (l[LANDING_TIME] - j * width) / dt
        mean[j] += (value - mean[j]) / min(l[LANDINGS] + 1.0, LEARNED_LANDINGS)
        l[POINT] += 1.0
    l[BEFORE_VELOCITY] = velocity
    if l[POINT] < LANDING_POINTS:
        return
    l[LANDINGS] += 1.0
    for j in range(SLOPE, LANDING_POINTS - SLOPE):
        acceleration = mean[j + SLOPE] - mean[j - SLOPE]
        largest = max(largest, acceleration)
        if acceleration <= 0.0 or (acceleration > before and before < LANDING_SHARE * largest):
            # Where it crosses zero, or at a minimum just above.
            value = LANDING_WIDTH * (j - acceleration / (acceleration - before) if acceleration < 0.0 else j - 1)
            if l[LANDINGS] >= FEWEST_LANDINGS and value >= SHORTEST_LEAD and value <= LONGEST_LEAD:
                l[OWN_LEAD] = value
            return
        before = acceleration


cdef int knee_kernel(double *arena, const Knee *at, const Knee *sizes) noexcept nogil:
    cdef double *timing = arena + at.events.timing
    cdef double *turns = arena + at.swing.turns
    cdef double *e = arena + at.extension
    cdef double *landing = arena + at.landing
    cdef double angle = arena[at.swing.angle]
    cdef double velocity = arena[at.velocity]
    if not (is_finite(angle) and is_finite(velocity)):
        return finish(arena, &at.events, True)
    angle = middle(arena + at.latest, angle)
    velocity = middle(arena + at.latest + 2, velocity)
    e[SINCE_SWING] += arena[DT]
    if swing_peak(arena, &at.swing, angle, 0.2):
        e[SWING_PERIOD] = min(STRIDE_LIMIT, e[SINCE_SWING] - turns[AGE])
        e[SINCE_SWING] = turns[AGE]
        e[EXTENDING] = 1.0
        e[EXTENSION_RATE] = 0.0
        e[SWING_ANGLE] = turns[BEFORE]
    if e[EXTENDING] != 0.0:
        e[EXTENSION_RATE] = min(e[EXTENSION_RATE], velocity)
        if angle < e[SWING_ANGLE] - 0.6 * turns[HEIGHT] and velocity > 0.5 * e[EXTENSION_RATE]:
            e[EXTENDING] = 0.0
            # A leg that swings as a pendulum, and one that rises from a squat, extends as slowly as it flexed.
            if -e[EXTENSION_RATE] * e[SWING_PERIOD] > EXTENSION_RATE_LIMIT * turns[HEIGHT]:
                # Angle and velocity are medians, one sample old.
                timing[DUE] = (landing[OWN_LEAD] or arena[at.lead]) * timing[STRIDE] - 2.0 * arena[DT]
                landing[LANDING_TIME] = -arena[DT]
                landing[LANDING_STRIDE] = timing[STRIDE]
                landing[POINT] = 0.0
        elif turns[RISING] > 0.0:
            e[EXTENDING] = 0.0          # flexes again before it was straight: no strike
    learn_landing(landing, velocity, arena[DT])
    return finish(arena, &at.events, False)


# Gyroscope

cdef struct Gyro:
    Events events
    int32_t velocity, smallest, lead
    int32_t peak                # typical and present peak of mid-swing, mean cube of the rate
    int32_t latest              # the last two samples

GYRO = items((<Gyro *>ITEMS)[0], "timing[4] peak[3] latest[2]")


cdef int gyro_kernel(double *arena, const Gyro *at, const Gyro *sizes) noexcept nogil:
    cdef double *timing = arena + at.events.timing
    cdef double *peak = arena + at.peak
    cdef double rate = arena[at.velocity]
    if not is_finite(rate):
        return finish(arena, &at.events, True)
    rate = middle(arena + at.latest, rate)
    peak[0] -= peak[0] * arena[DT] / RANGE_DECAY_TIME
    if peak[0] < arena[at.smallest]:
        peak[0] = arena[at.smallest]
    # 1. The forward swing is faster than the motion backward in stance, so that the mean of the cube is positive.
    peak[2] += (rate * rate * rate - peak[2]) * min(1.0, arena[DT] / RANGE_DECAY_TIME)
    # 2. An event is the end of a forward swing.
    if rate > 0.5 * peak[0] and rate > peak[1]:
        peak[1] = rate
    if peak[1] > 0.0 and rate < 0.0:
        peak[0] += (1.0 if peak[1] > peak[0] else 0.5) * (peak[1] - peak[0])
        if peak[2] > 0.0:
            timing[DUE] = arena[at.lead] * timing[STRIDE] - arena[DT]
        peak[1] = 0.0
    return finish(arena, &at.events, False)


contact_events = export(<kernel_t>contact_kernel, CONTACT)
thigh_events = export(<kernel_t>thigh_kernel, THIGH)
knee_events = export(<kernel_t>knee_kernel, KNEE)
gyro_events = export(<kernel_t>gyro_kernel, GYRO)
