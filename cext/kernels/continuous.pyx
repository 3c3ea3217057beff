# cython: freethreading_compatible=True
"""Blocks with continuous states: the steps of a Runge-Kutta method with error control, and derivatives of plants."""

from libc.math cimport exp, fabs, fmax, fmin, log, pow, sin, sinh, sqrt, tanh
from libc.stdint cimport int32_t

from cext.abi cimport DT, FIRST_OWN_STATUS, ITEMS, OK, Rest, each, export, items, kernel_t


cdef struct States:
    int32_t state
    Rest outputs

STATES = items((<States *>ITEMS)[0], "state[...] *outputs")


cdef int states_kernel(double *arena, const States *at, const States *sizes) noexcept nogil:
    """Copy the states to the outputs, in their order."""
    cdef double *x = arena + at.state
    cdef int k, i
    for k in range(at.outputs.count):
        for i in range(each(sizes, sizes.outputs)[k]):
            arena[each(at, at.outputs)[k] + i] = x[0]
            x += 1
    return OK


cdef enum:
    ATTEMPTS = 20000        # steps in one tick, accepted or not
    TOO_MANY_STEPS = FIRST_OWN_STATUS

cdef struct Control:        # of the integration of all blocks over a tick, in doubles
    double again            # 1 while the tick is not complete
    double elapsed          # s since the begin of the tick
    double step             # s, of this attempt
    double proposed         # s, the next step by the error; 0: none yet
    double error            # largest error over its tolerance
    double crossed          # 1 if a margin has become negative
    double low              # s, a step before the crossing
    double high             # s, a step after it; 0: none is looked for
    double accepted         # 1 if the attempt is part of the solution
    double attempts         # in this tick
    double adaptive         # 1: the last row of the tableau has the weights of the error
    double rtol             # tolerance relative to a state
    double atol             # tolerance in the unit of a state

cdef struct Shared:
    int32_t control

SHARED = items((<Shared *>ITEMS)[0], "control[13]")


cdef int begin_kernel(double *arena, const Shared *at, const Shared *sizes) noexcept nogil:
    """Prepare an attempt; at the begin of a tick, that of its first step."""
    cdef Control *c = <Control *>(arena + at.control)
    if c.again == 0.0:
        c.again, c.elapsed, c.low, c.high, c.attempts = 1.0, 0.0, 0.0, 0.0, 0.0
        c.step = next_step(c, arena[DT])
    c.error = c.crossed = 0.0
    return OK


cdef inline double next_step(const Control *c, double rest) noexcept nogil:
    """Return the step with which to go on. rest : s to the end of the tick"""
    if c.adaptive == 0.0 or c.proposed == 0.0 or c.proposed >= rest:
        return rest
    return min(c.proposed, rest / 2.0)      # no last step that is much shorter than the one before


cdef struct Integration:
    int32_t state, slope, origin, following, begun, slopes, tableau, stage, margin, before
    int32_t event, landed, control

INTEGRATION = items((<Integration *>ITEMS)[0], "state[...] slope[...] origin[...] following[...] begun[...] "
                    "slopes[...] tableau[...] control[13]")


cdef int advance_kernel(double *arena, const Integration *at, const Integration *sizes) noexcept nogil:
    """Keep the slope of a stage, and set the state to that of the next one: x = origin + h Σ a[stage, j] slopes[j].

    After the last of those stages the state is that at the end of the step. An adaptive method has one more, for its
    error: the largest one of the states over the tolerance, of all blocks.
    """
    cdef Control *c = <Control *>(arena + at.control)
    cdef int n = sizes.state
    cdef int stages = sizes.slopes // n
    cdef int stage = <int>arena[at.stage]
    cdef const double *row = arena + at.tableau + stage * stages
    cdef double *origin = arena + at.origin
    cdef double *following = arena + at.following
    cdef double total, error
    cdef int i, j
    for i in range(n):
        arena[at.slopes + stage * n + i] = arena[at.slope + i]
        if stage == 0:
            origin[i] = arena[at.state + i]
            if c.elapsed == 0.0:
                arena[at.begun + i] = origin[i]
        total = 0.0
        for j in range(stage + 1):
            total += row[j] * arena[at.slopes + j * n + i]
        if c.adaptive != 0.0 and stage == stages - 1:
            error = fabs(c.step * total) / (c.atol + c.rtol * fmax(fabs(origin[i]), fabs(following[i])))
            if error > c.error or error != error:       # NaN stays
                c.error = error
        else:
            following[i] = arena[at.state + i] = origin[i] + c.step * total
    if stage == 0:                          # a jump may leave the margin below 0 by its rounding
        arena[at.before] = fmax(arena[at.margin], 0.0) if arena[at.landed] != 0.0 else arena[at.margin]
    arena[at.stage] = (stage + 1) % stages
    return OK


cdef inline bint crosses(const double *arena, const Integration *at) noexcept nogil:
    """Return whether the margin to the event of a block has become negative in this step."""
    return arena[at.before] >= 0.0 and arena[at.margin] < 0.0


cdef int meet_kernel(double *arena, const Integration *at, const Integration *sizes) noexcept nogil:
    """Look for the time of a crossing, if there is one in this step."""
    if crosses(arena, at):
        (<Control *>(arena + at.control)).crossed = 1.0
    return OK


cdef int judge_kernel(double *arena, const Shared *at, const Shared *sizes) noexcept nogil:
    """Accept the attempt or not, and choose the next step.

    1. With an error above the tolerance the step is repeated with a shorter one. NaN ends the tick, unless it is that
       of a step that was too long.
    2. With a crossing, the step is bisected until its end is the first time at which the margin is negative.
    """
    cdef Control *c = <Control *>(arena + at.control)
    cdef double rest = arena[DT] - c.elapsed
    cdef double resolution = 1e-12 * arena[DT]
    cdef double factor
    cdef bint lost = c.error != c.error
    c.attempts += 1.0
    if c.attempts > ATTEMPTS:
        return TOO_MANY_STEPS
    factor = 0.1 if lost else 5.0 if c.error == 0.0 else min(5.0, max(0.2, 0.9 * pow(c.error, -0.2)))
    c.accepted = 0.0
    if c.error > 1.0 or lost and c.step > 1e-6 * arena[DT]:                         # 1.
        c.step *= factor
        c.proposed = c.step
        return OK
    if c.high > 0.0 or c.crossed != 0.0:                                            # 2.
        if c.crossed != 0.0:
            c.high = c.step
        else:
            c.low = c.step
        if c.high - c.low > resolution:
            c.step = (c.low + c.high) / 2.0
            return OK
        if c.crossed == 0.0:
            c.step = c.high
            return OK
    c.accepted = 1.0
    c.low = c.high = 0.0
    factor *= c.step
    c.proposed = factor if c.step >= c.proposed else max(c.proposed, factor)        # it was cut short: by the tick
    c.elapsed = arena[DT] if lost or c.step >= rest else c.elapsed + c.step
    rest = arena[DT] - c.elapsed
    c.proposed = min(c.proposed, arena[DT])
    c.again = rest > 0.0
    c.step = next_step(c, rest)
    return OK


cdef int commit_kernel(double *arena, const Integration *at, const Integration *sizes) noexcept nogil:
    """Set the state to that at the end of an accepted step, else to that at its begin."""
    cdef bint accepted = (<Control *>(arena + at.control)).accepted != 0.0
    cdef int32_t place = at.following if accepted else at.origin
    cdef int i
    for i in range(sizes.state):
        arena[at.state + i] = arena[place + i]
    arena[at.event] = accepted and crosses(arena, at)
    if accepted:
        arena[at.landed] = arena[at.event]
    return OK


cdef int close_kernel(double *arena, const Integration *at, const Integration *sizes) noexcept nogil:
    """At the end of the tick, restore the state of its begin, whose signals are then computed again."""
    cdef int i
    if (<Control *>(arena + at.control)).again == 0.0:
        for i in range(sizes.state):
            arena[at.following + i] = arena[at.state + i]
            arena[at.state + i] = arena[at.begun + i]
    return OK


cdef int finish_kernel(double *arena, const Integration *at, const Integration *sizes) noexcept nogil:
    """Set the state to that at the end of the tick."""
    cdef int i
    for i in range(sizes.state):
        arena[at.state + i] = arena[at.following + i]
    return OK


cdef struct Integral:
    int32_t u, slope

INTEGRAL = items((<Integral *>ITEMS)[0], "u[...] slope[...]")


cdef int integral_derivative(double *arena, const Integral *at, const Integral *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.u):
        arena[at.slope + i] = arena[at.u + i]
    return OK


cdef struct Pendulum:
    int32_t torque, position, velocity, mass, length, damping, gravity, slope

PENDULUM = items((<Pendulum *>ITEMS)[0], "slope[2]")


cdef int pendulum_derivative(double *arena, const Pendulum *at, const Pendulum *sizes) noexcept nogil:
    cdef double weight = arena[at.mass] * arena[at.length]
    arena[at.slope] = arena[at.velocity]
    arena[at.slope + 1] = (arena[at.torque] - arena[at.damping] * arena[at.velocity]
        - weight * arena[at.gravity] * sin(arena[at.position])) / (weight * arena[at.length])
    return OK


cdef struct Mass:
    int32_t force, position, velocity, mass, damping, stiffness, slope

MASS = items((<Mass *>ITEMS)[0], "slope[2]")


cdef int mass_derivative(double *arena, const Mass *at, const Mass *sizes) noexcept nogil:
    arena[at.slope] = arena[at.velocity]
    arena[at.slope + 1] = (arena[at.force] - arena[at.damping] * arena[at.velocity]
        - arena[at.stiffness] * arena[at.position]) / arena[at.mass]
    return OK


cdef struct Bouncer:
    int32_t force, position, velocity, mass, restitution, gravity, rest, slope, margin, state

BOUNCER = items((<Bouncer *>ITEMS)[0], "slope[2] state[2]")


cdef int bouncer_derivative(double *arena, const Bouncer *at, const Bouncer *sizes) noexcept nogil:
    cdef double v = arena[at.velocity]
    cdef double a = arena[at.force] / arena[at.mass] - arena[at.gravity]
    arena[at.slope] = v
    arena[at.slope + 1] = 0.0 if arena[at.position] == 0.0 and v == 0.0 and a < 0.0 else a
    return OK


cdef int bouncer_crossing(double *arena, const Bouncer *at, const Bouncer *sizes) noexcept nogil:
    arena[at.margin] = arena[at.position]
    return OK


cdef int bouncer_jump(double *arena, const Bouncer *at, const Bouncer *sizes) noexcept nogil:
    cdef double v = -arena[at.restitution] * arena[at.velocity]
    arena[at.state] = 0.0
    arena[at.state + 1] = 0.0 if v < arena[at.rest] else v
    return OK


cdef struct Motor:
    int32_t voltage, load, position, velocity, current, resistance, inductance, torque_constant, inertia, damping
    int32_t friction, slip, slope

MOTOR = items((<Motor *>ITEMS)[0], "slope[3]")


cdef int motor_derivative(double *arena, const Motor *at, const Motor *sizes) noexcept nogil:
    cdef double w = arena[at.velocity]
    cdef double i = arena[at.current]
    cdef double k = arena[at.torque_constant]
    arena[at.slope] = w
    arena[at.slope + 1] = (k * i - arena[at.load] - arena[at.damping] * w
        - arena[at.friction] * tanh(w / arena[at.slip])) / arena[at.inertia]
    arena[at.slope + 2] = (arena[at.voltage] - arena[at.resistance] * i - k * w) / arena[at.inductance]
    return OK


cdef struct Muscle:
    int32_t excitation, length, velocity, activation, force, max_force, fibre, tendon, pennation, max_velocity
    int32_t activation_time, deactivation_time, slope

MUSCLE = items((<Muscle *>ITEMS)[0], "slope[2]")


cdef inline double bell(double l, double height, double middle, double width, double growth) noexcept nogil:
    """One of the three curves of the force over the length of a fibre."""
    cdef double x = (l - middle) / (width + growth * l)
    return height * exp(-0.5 * x * x)


cdef int muscle_derivative(double *arena, const Muscle *at, const Muscle *sizes) noexcept nogil:
    """1. The fibre has the rest of the length, 2. and the velocity at which it has the force of the tendon."""
    cdef double a = arena[at.activation]
    cdef double u = fmin(1.0, fmax(0.01, arena[at.excitation]))         # NaN is rejected below
    cdef double tension = arena[at.force] / arena[at.max_force]
    cdef double optimal = arena[at.fibre]
    cdef double height = optimal * sin(arena[at.pennation])
    cdef double along, l, cosine, active, passive, speed, smooth, share
    smooth = 0.5 * tanh(0.1 * (u - a))
    share = 0.5 + 1.5 * a
    arena[at.slope] = (arena[at.excitation] - arena[at.excitation]) + (u - a) * (
        (0.5 + smooth) / (arena[at.activation_time] * share) + (0.5 - smooth) * share / arena[at.deactivation_time])
    along = arena[at.length] - arena[at.tendon] * (0.995 + log((tension + 0.25) / 0.2) / 35.0)      # 1.
    l = sqrt(along * along + height * height)
    cosine = along / l
    l /= optimal
    active = (bell(l, 0.815, 1.055, 0.162, 0.063) + bell(l, 0.433, 0.717, -0.030, 0.200)
        + bell(l, 0.1, 1.0, 0.35355339059327373, 0.0))
    passive = (exp(4.0 * (l - 1.0) / 0.6) - 1.0) / (exp(4.0) - 1.0)
    speed = (sinh(((tension / cosine - passive) / (a * active) - 0.886) / -0.318) + 0.374) / -8.149     # 2.
    arena[at.slope + 1] = 35.0 * (tension + 0.25) * arena[at.max_force] / arena[at.tendon] * (
        arena[at.velocity] - speed * arena[at.max_velocity] * optimal / cosine)
    return OK


states = export(<kernel_t>states_kernel, STATES)
advance = export(<kernel_t>advance_kernel, INTEGRATION)
begin = export(<kernel_t>begin_kernel, SHARED)
meet = export(<kernel_t>meet_kernel, INTEGRATION)
judge = export(<kernel_t>judge_kernel, SHARED)
commit = export(<kernel_t>commit_kernel, INTEGRATION)
close = export(<kernel_t>close_kernel, INTEGRATION)
finish = export(<kernel_t>finish_kernel, INTEGRATION)
integral = export(<kernel_t>integral_derivative, INTEGRAL)
pendulum = export(<kernel_t>pendulum_derivative, PENDULUM)
mass = export(<kernel_t>mass_derivative, MASS)
bouncer = export(<kernel_t>bouncer_derivative, BOUNCER)
bouncer_contact = export(<kernel_t>bouncer_crossing, BOUNCER)
bouncer_rebound = export(<kernel_t>bouncer_jump, BOUNCER)
muscle = export(<kernel_t>muscle_derivative, MUSCLE)
motor = export(<kernel_t>motor_derivative, MOTOR)
