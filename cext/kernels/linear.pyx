# cython: freethreading_compatible=True
"""Linear systems: cascades of biquads, transfer functions, state space.

Settling on a non-finite input starts from zero.
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, export, items, kernel_t


cdef struct Biquads:
    int32_t u, y, sections, delays, rest

BIQUADS = items((<Biquads *>ITEMS)[0], "u[...] y[...] sections[...] delays[...] rest[...]")


cdef int biquads_kernel(double *arena, const Biquads *at, const Biquads *sizes) noexcept nogil:
    """Step a cascade in direct form II transposed.

    sections : b0 b1 b2 a1 a2 of each
    delays : two of each section, for each element
    """
    cdef int sections = sizes.sections // 5
    cdef double *c
    cdef double *z = arena + at.delays
    cdef double x, y
    cdef int i, s
    for i in range(sizes.y):
        x = arena[at.u + i]
        c = arena + at.sections
        for s in range(sections):
            y = c[0] * x + z[0]
            z[0] = c[1] * x - c[3] * y + z[1]
            z[1] = c[2] * x - c[4] * y
            x = y
            c += 5
            z += 2
        arena[at.y + i] = x
    return OK


cdef int biquads_settle(double *arena, const Biquads *at, const Biquads *sizes) noexcept nogil:
    """Set the delays to the steady state at the present input.

    rest : of section s, from 3 s on: gain, first and second delay for an input of 1
    """
    cdef double *rest
    cdef double *z = arena + at.delays
    cdef double x
    cdef int i, s
    for i in range(sizes.y):
        x = arena[at.u + i] if isfinite(arena[at.u + i]) else 0.0
        rest = arena + at.rest
        for s in range(sizes.sections // 5):
            z[0] = rest[1] * x
            z[1] = rest[2] * x
            x = rest[0] * x
            rest += 3
            z += 2
    return OK


cdef struct Transfer:
    int32_t u, y, b, a, delays, rest

TRANSFER = items((<Transfer *>ITEMS)[0], "u[...] y[...] b[...] a[...] delays[...] rest[...]")


cdef int transfer_kernel(double *arena, const Transfer *at, const Transfer *sizes) noexcept nogil:
    """Compute the output in direct form II transposed; transfer_update steps the delays."""
    cdef int order = sizes.b - 1
    cdef double b0 = arena[at.b]
    cdef double *z = arena + at.delays
    cdef int i
    for i in range(sizes.y):
        if order == 0:
            arena[at.y + i] = b0 * arena[at.u + i]
        elif b0 == 0.0:
            arena[at.y + i] = z[i * order]          # no feedthrough: u is not available yet
        else:
            arena[at.y + i] = b0 * arena[at.u + i] + z[i * order]
    return OK


cdef int transfer_update(double *arena, const Transfer *at, const Transfer *sizes) noexcept nogil:
    cdef int order = sizes.b - 1
    cdef double *b = arena + at.b
    cdef double *a = arena + at.a
    cdef double *z = arena + at.delays
    cdef double u, y
    cdef int i, k
    for i in range(sizes.y):
        u = arena[at.u + i]
        y = arena[at.y + i]
        for k in range(order):
            z[k] = b[k + 1] * u - a[k + 1] * y + (z[k + 1] if k + 1 < order else 0.0)
        z += order
    return OK


cdef int transfer_settle(double *arena, const Transfer *at, const Transfer *sizes) noexcept nogil:
    """Set the delays to the steady state at the present input."""
    cdef int order = sizes.b - 1
    cdef double u
    cdef int i, k
    for i in range(sizes.y):
        u = arena[at.u + i] if isfinite(arena[at.u + i]) else 0.0
        for k in range(order):
            arena[at.delays + i * order + k] = arena[at.rest + k] * u
    return OK


cdef struct StateSpace:
    int32_t u, y, matrix_a, matrix_b, matrix_c, matrix_d, rest, state, following

STATE_SPACE = items(
    (<StateSpace *>ITEMS)[0],
    "u[...] y[...] matrix_a[...] matrix_b[...] matrix_c[...] matrix_d[...] rest[...] state[...] following[...]")


cdef inline double dot(const double *a, const double *x, int n) noexcept nogil:
    cdef double total = 0.0
    cdef int i
    for i in range(n):
        total += a[i] * x[i]
    return total


cdef int state_space_kernel(double *arena, const StateSpace *at, const StateSpace *sizes) noexcept nogil:
    """Compute y = C x + D u. With an empty D, u is not available yet and not read."""
    cdef int n = sizes.state
    cdef int m = sizes.u
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = dot(arena + at.matrix_c + i * n, arena + at.state, n)
        if sizes.matrix_d > 0:
            arena[at.y + i] += dot(arena + at.matrix_d + i * m, arena + at.u, m)
    return OK


cdef int state_space_update(double *arena, const StateSpace *at, const StateSpace *sizes) noexcept nogil:
    """Compute x = A x + B u."""
    cdef int n = sizes.state
    cdef int m = sizes.u
    cdef double *x = arena + at.state
    cdef double *following = arena + at.following
    cdef int i
    for i in range(n):
        following[i] = dot(arena + at.matrix_a + i * n, x, n) + dot(arena + at.matrix_b + i * m, arena + at.u, m)
    for i in range(n):
        x[i] = following[i]
    return OK


cdef int state_space_settle(double *arena, const StateSpace *at, const StateSpace *sizes) noexcept nogil:
    """Set x = (I - A)^-1 B u, the steady state."""
    cdef int i
    for i in range(sizes.u):
        if not isfinite(arena[at.u + i]):
            return OK
    for i in range(sizes.state):
        arena[at.state + i] = dot(arena + at.rest + i * sizes.u, arena + at.u, sizes.u)
    return OK


biquads = export(<kernel_t>biquads_kernel, BIQUADS)
biquads_at_rest = export(<kernel_t>biquads_settle, BIQUADS)
transfer = export(<kernel_t>transfer_kernel, TRANSFER)
transfer_next = export(<kernel_t>transfer_update, TRANSFER)
transfer_at_rest = export(<kernel_t>transfer_settle, TRANSFER)
state_space = export(<kernel_t>state_space_kernel, STATE_SPACE)
state_space_next = export(<kernel_t>state_space_update, STATE_SPACE)
state_space_at_rest = export(<kernel_t>state_space_settle, STATE_SPACE)
