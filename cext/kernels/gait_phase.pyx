# cython: freethreading_compatible=True
"""Estimators of the gait phase."""

from libc.math cimport INFINITY, NAN, atan2, cos, fabs, floor, log, sin, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport is_finite

cdef enum:
    HARMONICS = 8
    LEARNED_STRIKES = 10
    PLACES = 32                 # phases that are compared with angle and velocity after a stand

cdef double TURN = 6.283185307179586
cdef double CADENCE_LIMIT = 2.5         # Hz
cdef double MISFIT_LIMIT = 0.5           # mean squared deviation over the variance of a stride
cdef double OUTLIER_LIMIT = 4.0          # squared deviation, more of which a single sample does not count
cdef double SLIP_LIMIT = 0.5             # standard deviations, from stride to waveform: a sensor has slipped
cdef double UNLIKE_LIMIT = 0.2           # of a stride, between a strike and the phase: the filter starts again
cdef double CADENCE_TIME = 1.0           # s, with which the frequency returns to that of the last stride
cdef double ANGLE_TIME = 0.05            # s, of each of two low-passes for the velocity of an angle
cdef double ANGLE_SHARE = 0.15            # of the usual velocity
cdef double IDLE_TIME = 0.2             # s below it: the leg stands
cdef double FREQUENCY_SHARE = 0.25      # of the cadence, from which the frequency of the oscillators may differ
cdef double QUIET_LIMIT = 0.4            # strides without motion: the leg stands
cdef double HOLD_LIMIT = 0.8             # strides, after which the phase is that at which the leg came to rest
cdef double MOTION_TIME = 0.1            # s, over which the motion of a leg is averaged
cdef double REST_TIME = 0.03             # s, of the low-pass for the velocity of a leg that comes to rest
cdef double REST_SHARE = 0.05            # of the usual velocity, below which it rests
cdef double REST_VARIANCE = 0.01         # of the phase at which it came to rest, in strides²
cdef double CONTRADICTION = 4.0          # squared errors in variances, by which another phase must be better
cdef double MOVING_SHARE = 0.3           # of the usual velocity: the leg moves
cdef double SLOWEST_SHARE = 0.5          # of the usual cadence: the frequency of a leg that moves
cdef double WALKING_CADENCE = 0.3       # Hz, below it the leg stands, unless the wearer walks that slowly
cdef double SPREAD_SHARE = 0.2          # of a strike, in the spread of the last strides
cdef double KNOWN_LENGTH = 0.5          # of the mean of a phase on the circle: it is known
cdef double CIRCLE_TIME = 0.3           # s, over which its variance is averaged
cdef double UNKNOWN = 0.28867513459481287       # standard deviation of a phase of which nothing is known


cdef inline double wrapped(double phase) noexcept nogil:
    """Return a phase in 0 <= phase < 1; 1 - epsilon cannot round to 1."""
    phase -= floor(phase)
    return phase if phase < 1.0 else 0.0


cdef inline double nearest(double difference) noexcept nogil:
    """Return a difference of phases, the shorter way round."""
    return difference - floor(difference + 0.5)


cdef inline void enter_error(double *spread, double error) noexcept nogil:
    """Enter the phase error at a strike, in strides, into the mean square of the last strides."""
    spread[0] += SPREAD_SHARE * (min(error * error, UNKNOWN * UNKNOWN) - spread[0])


# Time since strike

cdef struct Stride:
    int32_t strike, phase, walking, stride_time, uncertainty, shortest, longest, count
    int32_t state               # s since the strike, mean stride time, number of consecutive strides, spread

STRIDE = items((<Stride *>ITEMS)[0], "state[4]")


cdef int stride_kernel(double *arena, const Stride *at, const Stride *sizes) noexcept nogil:
    cdef double strike = arena[at.strike]
    cdef double *s = arena + at.state
    cdef double share
    s[0] += arena[DT]
    if strike != 0.0 and strike == strike:
        if s[0] >= arena[at.shortest] and s[0] <= arena[at.longest]:
            if s[2] > 0.0:
                enter_error(&s[3], s[0] / s[1] - 1.0)
            s[2] += 1.0
            share = 1.0 / min(s[2], arena[at.count])
            s[1] += share * (s[0] - s[1])
        else:
            s[2] = 0.0
        s[0] = 0.0
    elif s[0] > arena[at.longest] or (s[2] > 0.0 and s[0] > 1.5 * s[1]):
        s[2] = 0.0
        s[0] = INFINITY
    arena[at.phase] = 0.0 if strike == strike else NAN
    arena[at.uncertainty] = UNKNOWN if strike == strike else NAN
    arena[at.walking] = 0.0
    arena[at.stride_time] = 0.0
    if s[2] >= 2.0:
        arena[at.stride_time] = s[1]
        if strike == strike:
            arena[at.uncertainty] = sqrt(s[3])
            arena[at.phase] = min(s[0] / s[1], 1.0)
            arena[at.walking] = 1.0
    return OK


# Mean of a phase on the circle

cdef struct Circle:
    int32_t cosine, sine, phase, walking, uncertainty
    int32_t variance            # of the phase, a mean; negative while unknown

CIRCLE = items((<Circle *>ITEMS)[0])


cdef int circle_kernel(double *arena, const Circle *at, const Circle *sizes) noexcept nogil:
    cdef double cosine = arena[at.cosine]
    cdef double sine = arena[at.sine]
    cdef double *variance = arena + at.variance
    cdef double square = cosine * cosine + sine * sine
    cdef double spread
    arena[at.walking] = 0.0
    if not is_finite(square):
        arena[at.phase] = arena[at.uncertainty] = NAN
        return OK
    arena[at.phase] = wrapped(atan2(sine, cosine) / TURN)
    arena[at.uncertainty] = UNKNOWN
    if square > KNOWN_LENGTH * KNOWN_LENGTH:
        spread = max(0.0, -log(square)) / (TURN * TURN)
        if variance[0] < 0.0:
            variance[0] = spread
        variance[0] += min(1.0, arena[DT] / CIRCLE_TIME) * (spread - variance[0])
        arena[at.walking] = 1.0
        arena[at.uncertainty] = sqrt(variance[0])
    else:
        variance[0] = -1.0
    return OK


# Phase portrait

cdef struct Portrait:
    int32_t angle, velocity, strike, phase, walking
    int32_t extremes            # smallest, largest angle, largest speed: in use, then of this stride
    int32_t zero                # sum of cosines and sines of the angle at strikes, their number, s since the last
    int32_t latest              # the phase before

PORTRAIT = items((<Portrait *>ITEMS)[0], "extremes[6] zero[4]")


cdef inline void learn_zero(double *zero, double turns) noexcept nogil:
    """Enter the phase at a strike, in turns, into the zero of the wearer, learned in the first ten strikes."""
    if zero[2] < LEARNED_STRIKES:
        zero[0] += cos(TURN * turns)
        zero[1] += sin(TURN * turns)
        zero[2] += 1.0


cdef int portrait_kernel(double *arena, const Portrait *at, const Portrait *sizes) noexcept nogil:
    cdef double angle = arena[at.angle]
    cdef double velocity = arena[at.velocity]
    cdef double strike = arena[at.strike]
    cdef double *e = arena + at.extremes
    cdef double *zero = arena + at.zero
    cdef double *latest = arena + at.latest
    cdef double turns, advance
    cdef int k
    if not (is_finite(angle) and is_finite(velocity)) or strike != strike:
        arena[at.phase] = NAN
        arena[at.walking] = 0.0
        return OK
    zero[3] += arena[DT]
    e[3] = min(e[3], angle)
    e[4] = max(e[4], angle)
    e[5] = max(e[5], fabs(velocity))
    turns = 0.0
    if e[1] > e[0] and e[2] > 0.0:
        turns = atan2(-velocity / e[2], (2.0 * angle - e[0] - e[1]) / (e[1] - e[0])) / TURN
    if strike != 0.0:
        if zero[3] < 3.0:       # a whole stride: its extremes scale the next one
            if e[1] > e[0]:     # those of the stride before are known
                learn_zero(zero, turns)
            for k in range(3):
                e[k] = e[3 + k]
        e[3] = INFINITY
        e[4] = -INFINITY
        e[5] = 0.0
        zero[3] = 0.0
    arena[at.phase] = 0.0
    arena[at.walking] = 0.0
    if zero[2] >= 3.0:
        turns = wrapped(turns - atan2(zero[1], zero[0]) / TURN)
        advance = nearest(turns - latest[0])
        # Noise does not run the phase backwards, and only a strike begins a stride: the thigh turns back before it.
        if strike != 0.0:
            latest[0] = turns if turns < 0.5 else 0.0
        elif advance >= 0.0 and turns >= latest[0]:
            latest[0] = turns
        elif advance > 0.0:
            latest[0] = 1.0
        arena[at.phase] = latest[0]
        arena[at.walking] = zero[3] < 3.0
    return OK


# Adaptive oscillators

cdef struct Oscillator:
    int32_t angle, strike, phase, walking, frequency
    int32_t phase_gain, frequency_gain, amplitude_gain, correction
    int32_t state               # see below
    int32_t amplitudes          # amplitude, then phase in rad of each oscillator
    int32_t zero                # as in the portrait

OSCILLATOR = items((<Oscillator *>ITEMS)[0], "state[11] amplitudes[...] zero[4]")

cdef enum:
    ZERO = 0                    # phase of the first oscillator at heel strike, in strides
    RATE = 1                    # frequency in rad/s
    MEAN = 2                    # α₀
    TIME = 3                    # s of learning
    ERROR = 4                   # mean squared error
    SMOOTH = 5                  # angle after a low-pass
    VELOCITY = 6                # of that, after another
    IDLE = 7                    # s below ANGLE_SHARE of the usual velocity
    STOOD = 8                   # 1 if the leg stood since the last strike
    INTERVAL = 9                # s between the last two strikes
    ASTRAY = 10                 # 1 if the last strike was far from phase 0


cdef int oscillator_kernel(double *arena, const Oscillator *at, const Oscillator *sizes) noexcept nogil:
    cdef double angle = arena[at.angle]
    cdef double strike = arena[at.strike]
    cdef double dt = arena[DT]
    cdef double *s = arena + at.state
    cdef double *a = arena + at.amplitudes
    cdef double *zero = arena + at.zero
    cdef int n = sizes.amplitudes // 2
    cdef double error, total, power, speed, push, first, share
    cdef bint moving, regular
    cdef int i
    if not is_finite(angle) or strike != strike:
        arena[at.phase] = NAN
        arena[at.walking] = 0.0
        arena[at.frequency] = NAN
        return OK
    # 1. The learned signal: offset and one oscillator for each harmonic.
    error = angle - s[MEAN]
    total = power = speed = 0.0
    for i in range(n):
        error -= a[i] * sin(a[n + i])
        total += fabs(a[i])
        power += 0.5 * a[i] * a[i]
        speed += 0.5 * a[i] * a[i] * (i + 1) * (i + 1)
    # 2. While the leg stands, nothing is learned, and the oscillators follow the angle without their frequency.
    share = min(1.0, dt / ANGLE_TIME)
    s[VELOCITY] += share * ((angle - s[SMOOTH]) / ANGLE_TIME - s[VELOCITY])
    s[SMOOTH] += share * (angle - s[SMOOTH])
    s[IDLE] = s[IDLE] + dt if fabs(s[VELOCITY]) < ANGLE_SHARE * s[RATE] * sqrt(speed) else 0.0
    moving = s[IDLE] < IDLE_TIME
    # 3. Each oscillator follows its share of the error; the first one also adapts the frequency.
    push = error / max(total, 1e-3)
    push = max(-1.0, min(1.0, push))
    first = cos(a[n])
    if moving:
        s[MEAN] += arena[at.amplitude_gain] * error * dt
        for i in range(n):
            a[i] += arena[at.amplitude_gain] * error * sin(a[n + i]) * dt
    else:
        s[STOOD] = 1.0
    for i in range(n):
        a[n + i] += ((i + 1) * (s[RATE] if moving else 0.0) + arena[at.phase_gain] * push * cos(a[n + i])) * dt
        a[n + i] -= TURN * floor(a[n + i] / TURN)
    if moving:
        s[RATE] += arena[at.frequency_gain] * push * first * dt
        s[RATE] = max(0.1 * TURN, min(CADENCE_LIMIT * TURN, s[RATE]))
        s[TIME] += dt
    s[ERROR] += (error * error - s[ERROR]) * min(1.0, dt)
    # 4. Phase zero at heel strike: learned in the first ten strikes, then corrected at each.
    zero[3] += dt
    if strike != 0.0:
        # A frequency that two strides contradict has locked to a harmonic, or to the motion before walking.
        regular = zero[3] >= 0.4 and zero[3] <= 2.5 and fabs(s[INTERVAL] - zero[3]) < FREQUENCY_SHARE * zero[3]
        if arena[at.correction] > 0.0 and regular and fabs(s[RATE] * zero[3] / TURN - 1.0) > FREQUENCY_SHARE:
            s[RATE] = TURN / zero[3]
        s[INTERVAL] = zero[3]
        zero[3] = 0.0
        if s[TIME] > 4.0:
            if zero[2] < LEARNED_STRIKES:
                learn_zero(zero, a[n] / TURN)
                s[ZERO] = atan2(zero[1], zero[0]) / TURN
            else:
                share = 1.0 if s[STOOD] != 0.0 else arena[at.correction]
                push = nearest(a[n] / TURN - s[ZERO])
                s[ZERO] += share * push
                s[ASTRAY] = s[STOOD] == 0.0 and fabs(push) > UNLIKE_LIMIT
        s[STOOD] = 0.0
    arena[at.frequency] = s[RATE] / TURN if moving else 0.0
    arena[at.walking] = zero[2] >= 3.0 and moving and s[ASTRAY] == 0.0 and s[ERROR] < 0.25 * power
    arena[at.phase] = wrapped(a[n] / TURN - s[ZERO]) if zero[2] >= 3.0 else 0.0
    return OK


# Kalman filter on a learned waveform

cdef struct Kalman:
    int32_t angle, velocity, strike, phase, walking, frequency, deviation, uncertainty
    int32_t phase_noise, frequency_noise, angle_noise, velocity_noise, strike_noise, strike_offset
    int32_t state               # phase, frequency in Hz, amplitude, offset, both relative to the waveform
    int32_t covariance          # 4 x 4
    int32_t waveform            # mean, then a cosine and a sine amplitude per harmonic
    int32_t stride              # the angles since the last strike
    int32_t learning            # see below

KALMAN = items((<Kalman *>ITEMS)[0], "state[4] covariance[16] waveform[17] stride[...] learning[17]")

cdef enum:
    SINCE = 0                   # s since the last strike
    SAMPLES = 1                 # stored since then
    STRIDES = 2                 # that the waveform was learned from
    REJECTED = 3                # consecutive strides of another shape
    RUNNING = 4                 # 1 once the filter runs
    MISFIT = 5                  # mean squared deviation
    LOST = 6                    # 1 if the leg moved unlike the waveform since the last strike, 2 if it stood
    CADENCE = 7                 # Hz, of the last stride
    POWER = 8                   # standard deviation of the waveform
    SPEED = 9                   # standard deviation of its derivative, per stride
    LATEST = 10                 # phase one tick before
    MOTION = 11                 # mean squared velocity
    QUIET = 12                  # strides without motion
    OFFSET = 13                 # mean of the last stride less that of the waveform, over its standard deviation
    SPREAD = 14                 # mean square of the phase at the last strikes
    SLOW = 15                   # velocity after a low-pass
    REST = 16                   # phase at which the leg came to rest


cdef inline void spectrum(const double *x, int n, double *mean, double *cosines, double *sines) noexcept nogil:
    """The Fourier coefficients of one period of n samples."""
    cdef double c, s, c1, s1, t
    cdef int h, i
    mean[0] = 0.0
    for i in range(n):
        mean[0] += x[i] / n
    for h in range(HARMONICS):
        c1 = cos(TURN * (h + 1) / n)
        s1 = sin(TURN * (h + 1) / n)
        c = 1.0
        s = 0.0
        cosines[h] = sines[h] = 0.0
        for i in range(n):
            cosines[h] += x[i] * c
            sines[h] += x[i] * s
            t = c * c1 - s * s1
            s = s * c1 + c * s1
            c = t
        cosines[h] *= 2.0 / n
        sines[h] *= 2.0 / n


cdef inline void learn(double *w, double *learning, const double *x, int n) noexcept nogil:
    """Average one stride into the waveform, unless its shape differs.

    Three different ones in a row, or a second that differs from the first, start it again.
    """
    cdef double mean
    cdef double c[HARMONICS]
    cdef double s[HARMONICS]
    cdef double power = 0.0
    cdef double unlike = 0.0
    cdef double share, t
    cdef int h
    spectrum(x, n, &mean, c, s)
    for h in range(HARMONICS):
        power += w[1 + h] * w[1 + h] + w[1 + HARMONICS + h] * w[1 + HARMONICS + h]
        unlike += (c[h] - w[1 + h]) * (c[h] - w[1 + h]) + (s[h] - w[1 + HARMONICS + h]) * (s[h] - w[1 + HARMONICS + h])
    if learning[STRIDES] > 0.0 and unlike > 0.25 * power:
        learning[REJECTED] += 1.0
        if learning[REJECTED] < 3.0 and learning[STRIDES] > 1.0:
            return
        learning[STRIDES] = 0.0
    learning[REJECTED] = 0.0
    learning[STRIDES] += 1.0
    share = 1.0 / min(learning[STRIDES], LEARNED_STRIKES)
    w[0] += share * (mean - w[0])
    for h in range(HARMONICS):
        w[1 + h] += share * (c[h] - w[1 + h])
        w[1 + HARMONICS + h] += share * (s[h] - w[1 + HARMONICS + h])
    learning[POWER] = learning[SPEED] = 0.0
    for h in range(HARMONICS):
        t = 0.5 * (w[1 + h] * w[1 + h] + w[1 + HARMONICS + h] * w[1 + HARMONICS + h])
        learning[POWER] += t
        learning[SPEED] += t * (h + 1) * (h + 1)
    learning[POWER] = max(sqrt(learning[POWER]), 1e-9)
    learning[SPEED] = max(TURN * sqrt(learning[SPEED]), 1e-9)
    learning[OFFSET] = (mean - w[0]) / learning[POWER]


cdef inline void begin(double *x, double *p, const double *learning, double phase, double variance) noexcept nogil:
    """Start the filter at a phase, with the frequency of the last stride. variance : of the phase"""
    cdef int i
    x[0] = phase
    x[1] = learning[CADENCE]
    x[2] = 1.0
    for i in range(16):
        p[i] = 0.0
    p[0] = variance
    p[5] = 1e-2
    p[10] = p[15] = 1e-3


cdef inline double mismatch(const double *arena, const Kalman *at, double phase) noexcept nogil:
    """Return the squared errors of angle and velocity at a phase and the usual cadence, in variances of their noise."""
    cdef const double *w = arena + at.waveform
    cdef const double *learning = arena + at.learning
    cdef double c1 = cos(TURN * phase)
    cdef double s1 = sin(TURN * phase)
    cdef double c = 1.0
    cdef double s = 0.0
    cdef double angle = w[0]
    cdef double slope = 0.0
    cdef double t
    cdef int h
    for h in range(HARMONICS):
        t = c * c1 - s * s1
        s = s * c1 + c * s1
        c = t
        angle += w[1 + h] * c + w[1 + HARMONICS + h] * s
        slope += TURN * (h + 1) * (w[1 + HARMONICS + h] * c - w[1 + h] * s)
    angle = (arena[at.angle] - angle) / (learning[POWER] * arena[at.angle_noise])
    slope = (arena[at.velocity] / learning[CADENCE] - slope) / (learning[SPEED] * arena[at.velocity_noise])
    return angle * angle + slope * slope


cdef inline void correct(double *x, double *p, const double *gradient, double error, double variance) noexcept nogil:
    """One scalar measurement update. The error is limited to three standard deviations."""
    cdef double gain[4]
    cdef double total = variance
    cdef double most
    cdef int i, j
    for i in range(4):
        gain[i] = 0.0
        for j in range(4):
            gain[i] += p[4 * i + j] * gradient[j]
        total += gain[i] * gradient[i]
    most = 3.0 * sqrt(total)
    error = max(-most, min(most, error))
    for i in range(4):
        x[i] += gain[i] * error / total
    for i in range(4):
        for j in range(4):
            p[4 * i + j] -= gain[i] * gain[j] / total


cdef int kalman_kernel(double *arena, const Kalman *at, const Kalman *sizes) noexcept nogil:
    cdef double angle = arena[at.angle]
    cdef double velocity = arena[at.velocity]
    cdef double strike = arena[at.strike]
    cdef double dt = arena[DT]
    cdef double *x = arena + at.state
    cdef double *p = arena + at.covariance
    cdef double *w = arena + at.waveform
    cdef double *learning = arena + at.learning
    cdef double gradient[4]
    cdef double deviation = 0.0
    cdef double power, speed, shape, slope, bend, jerk, c, s, c1, s1, t, error, pace, before, least
    cdef bint unlike, stood
    cdef int pass_, h, i
    if not (is_finite(angle) and is_finite(velocity)) or strike != strike:
        arena[at.phase] = NAN
        arena[at.walking] = 0.0
        arena[at.frequency] = NAN
        arena[at.deviation] = arena[at.uncertainty] = NAN
        return OK
    learning[SINCE] += dt
    # 1. A stride between two strikes enters the waveform. The filter starts at a strike: after two strides, at the first
    #    one after standing, and at one that is far from phase 0.
    if strike != 0.0:
        unlike = fabs(nearest(x[0])) > UNLIKE_LIMIT
        if learning[RUNNING] != 0.0 and learning[LOST] == 0.0:
            enter_error(learning + SPREAD, nearest(x[0]))
        if learning[SINCE] >= 0.4 and learning[SINCE] <= 2.5 and learning[SAMPLES] <= sizes.stride:
            learn(w, learning, arena + at.stride, <int>learning[SAMPLES])
            if learning[STRIDES] >= 2.0 and learning[RUNNING] == 0.0:
                learning[RUNNING] = learning[LOST] = 1.0
            if learning[LOST] == 0.0 or learning[CADENCE] == 0.0:
                learning[CADENCE] = 1.0 / learning[SINCE]
        if learning[RUNNING] != 0.0 and (learning[LOST] != 0.0 or unlike):
            learning[LOST] = learning[MISFIT] = 0.0
            begin(x, p, learning, 0.0, 1e-3)
            x[3] = learning[OFFSET] if fabs(learning[OFFSET]) > SLIP_LIMIT else 0.0
        elif learning[RUNNING] != 0.0:
            gradient[0] = 1.0
            gradient[1] = gradient[2] = gradient[3] = 0.0
            correct(x, p, gradient, -nearest(x[0]), arena[at.strike_noise] * arena[at.strike_noise])
        learning[SINCE] = learning[SAMPLES] = learning[LATEST] = 0.0
        learning[REST] = x[0]
    if learning[SAMPLES] < sizes.stride:
        arena[at.stride + <int>learning[SAMPLES]] = angle
    learning[SAMPLES] = min(learning[SAMPLES] + 1.0, sizes.stride + 1.0)
    if learning[RUNNING] != 0.0 and learning[STRIDES] > 0.0:
        # 2. Predict: the phase advances at the frequency.
        before = x[0]
        pace = max(x[1], 0.05) * dt
        x[0] += x[1] * dt
        x[1] += (learning[CADENCE] - x[1]) * dt / CADENCE_TIME
        for i in range(4):
            p[i] += dt * p[4 + i]
        for i in range(4):
            p[4 * i] += dt * p[4 * i + 1]
        p[0] += arena[at.phase_noise] * arena[at.phase_noise] * pace
        p[5] += arena[at.frequency_noise] * arena[at.frequency_noise] * dt
        p[10] += 1e-4 * pace
        p[15] += 1e-4 * pace
        power = learning[POWER]
        speed = learning[SPEED]
        # 3. Correct by the angle, then by the velocity, each relative to its standard deviation over the stride.
        for pass_ in range(2):
            c1 = cos(TURN * x[0])
            s1 = sin(TURN * x[0])
            c = 1.0
            s = 0.0
            shape = slope = bend = jerk = 0.0
            for h in range(HARMONICS):
                t = c * c1 - s * s1
                s = s * c1 + c * s1
                c = t
                t = TURN * (h + 1)
                error = w[1 + h] * c + w[1 + HARMONICS + h] * s
                shape += error
                bend -= t * t * error
                error = w[1 + HARMONICS + h] * c - w[1 + h] * s
                slope += t * error
                jerk -= t * t * t * error
            if pass_ == 0:
                gradient[0] = x[2] * slope / power
                gradient[1] = 0.0
                gradient[2] = shape / power
                gradient[3] = 1.0
                error = (angle - w[0] - x[2] * shape) / power - x[3]
                deviation = error
                t = x[2] * bend / power * p[0]
                correct(x, p, gradient, error, arena[at.angle_noise] * arena[at.angle_noise] + 0.5 * t * t)
            else:
                gradient[0] = x[2] * bend * x[1] / speed
                gradient[1] = x[2] * slope / speed
                gradient[2] = slope * x[1] / speed
                gradient[3] = 0.0
                error = (velocity - x[2] * slope * x[1]) / speed
                t = x[2] * jerk * x[1] / speed * p[0]
                c = arena[at.velocity_noise] * max(x[1], 0.3)
                correct(x, p, gradient, error, c * c + 0.5 * t * t)
        x[0] = wrapped(x[0])
        # 4. A leg that moves neither stands nor goes back: at a turning point it is the velocity that is undetermined.
        t = MOVING_SHARE * speed * learning[CADENCE]
        learning[MOTION] += (velocity * velocity - learning[MOTION]) * min(1.0, dt / MOTION_TIME)
        learning[SLOW] += (velocity - learning[SLOW]) * min(1.0, dt / REST_TIME)
        stood = learning[QUIET] > QUIET_LIMIT
        learning[QUIET] = learning[QUIET] + learning[CADENCE] * dt if learning[MOTION] < 0.25 * t * t else 0.0
        if not stood and fabs(learning[SLOW]) > REST_SHARE * speed * learning[CADENCE]:
            learning[REST] = x[0]
        # 5. In a stand the angle does not determine the phase: it continues where the leg came to rest, or, until the
        #    next strike, at the phase with which angle and velocity agree.
        if learning[QUIET] > HOLD_LIMIT or (stood and learning[QUIET] == 0.0):
            begin(x, p, learning, learning[REST], REST_VARIANCE)
            before = x[0]
        if learning[LOST] > 1.0 and learning[QUIET] == 0.0:
            least = mismatch(arena, at, x[0]) - CONTRADICTION
            for h in range(PLACES):
                error = mismatch(arena, at, h / <double>PLACES)
                if error < least:
                    least = error
                    x[0] = before = h / <double>PLACES
                    x[1] = learning[CADENCE]
        t = SLOWEST_SHARE * learning[CADENCE] if learning[MOTION] > t * t else 0.0
        if x[1] < t:
            x[1] = t
            p[0] = max(p[0], 1e-3)
            p[5] = max(p[5], 1e-2)
        if nearest(x[0] - before) < t * dt:
            x[0] = wrapped(before + t * dt)
        x[1] = min(CADENCE_LIMIT, x[1])
        x[2] = max(0.3, min(2.0, x[2]))
        learning[MISFIT] += (min(deviation * deviation, OUTLIER_LIMIT) - learning[MISFIT]) * min(1.0, 5.0 * dt)
        t = min(WALKING_CADENCE, SLOWEST_SHARE * learning[CADENCE])
        if x[1] < t or learning[QUIET] > QUIET_LIMIT or learning[MISFIT] > MISFIT_LIMIT:
            learning[LOST] = 2.0 if learning[QUIET] > QUIET_LIMIT else max(learning[LOST], 1.0)
        if not is_finite(x[0] + x[1] + x[2] + x[3]):
            learning[RUNNING] = learning[STRIDES] = 0.0
            x[0] = 0.0
            deviation = 0.0
    arena[at.deviation] = deviation
    arena[at.phase] = arena[at.frequency] = arena[at.walking] = 0.0
    if learning[RUNNING] != 0.0:
        # A stride begins once, at its strike at the latest: the phase does not return to the stride before.
        if learning[LATEST] < UNLIKE_LIMIT and x[0] > 1.0 - UNLIKE_LIMIT:
            arena[at.phase] = 0.0
        else:
            learning[LATEST] = x[0]
            arena[at.phase] = x[0]
        arena[at.frequency] = x[1] if learning[QUIET] <= HOLD_LIMIT else 0.0
        arena[at.walking] = learning[LOST] == 0.0
    arena[at.uncertainty] = UNKNOWN
    if arena[at.walking] != 0.0:
        arena[at.uncertainty] = min(UNKNOWN, sqrt(learning[SPREAD] + arena[at.strike_offset] * arena[at.strike_offset]))
    return OK


stride_phase = export(<kernel_t>stride_kernel, STRIDE)
circle_phase = export(<kernel_t>circle_kernel, CIRCLE)
phase_portrait = export(<kernel_t>portrait_kernel, PORTRAIT)
adaptive_oscillator = export(<kernel_t>oscillator_kernel, OSCILLATOR)
phase_kalman = export(<kernel_t>kalman_kernel, KALMAN)
