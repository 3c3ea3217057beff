# cython: freethreading_compatible=True
"""Blocks with continuous states: the steps of an explicit Runge-Kutta method, and derivatives of plants."""

from libc.math cimport sin, tanh
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, Rest, each, export, items, kernel_t


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


cdef struct Integration:
    int32_t state, slope, origin, following, slopes, tableau, stage

INTEGRATION = items((<Integration *>ITEMS)[0],
                    "state[...] slope[...] origin[...] following[...] slopes[...] tableau[...]")


cdef int advance_kernel(double *arena, const Integration *at, const Integration *sizes) noexcept nogil:
    """Keep the slope of a stage, and set the state to that of the next one: x = origin + dt Σ a[stage, j] slopes[j].

    After the last stage that sum is the state at the end of the tick. It is `following`, and the state is again that at
    the begin, so that the signals of the tick can be computed once more.
    """
    cdef int n = sizes.state
    cdef int stages = sizes.slopes // n
    cdef int stage = <int>arena[at.stage]
    cdef const double *row = arena + at.tableau + stage * stages
    cdef double total
    cdef int i, j
    for i in range(n):
        arena[at.slopes + stage * n + i] = arena[at.slope + i]
        if stage == 0:
            arena[at.origin + i] = arena[at.state + i]
        total = 0.0
        for j in range(stage + 1):
            total += row[j] * arena[at.slopes + j * n + i]
        arena[at.following + i] = arena[at.origin + i] + arena[DT] * total
        arena[at.state + i] = arena[at.origin + i] if stage == stages - 1 else arena[at.following + i]
    arena[at.stage] = (stage + 1) % stages
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


states = export(<kernel_t>states_kernel, STATES)
advance = export(<kernel_t>advance_kernel, INTEGRATION)
finish = export(<kernel_t>finish_kernel, INTEGRATION)
integral = export(<kernel_t>integral_derivative, INTEGRAL)
pendulum = export(<kernel_t>pendulum_derivative, PENDULUM)
mass = export(<kernel_t>mass_derivative, MASS)
motor = export(<kernel_t>motor_derivative, MOTOR)
