# cython: freethreading_compatible=True
"""Linear systems: cascades of biquads, transfer functions, state space. To settle on what is not finite is to start at zero."""

from libc.math cimport isfinite
from libc.stdint cimport int32_t

from cext.abi cimport OK, PARAMETERS, export


cdef int biquads_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], parameters, then sections[5 s] as b0 b1 b2 a1 a2, delays[2 s n], rest; direct form II transposed
    cdef int first = 2 + slots[PARAMETERS]
    cdef int sections = sizes[first] // 5
    cdef double *c
    cdef double *z = arena + slots[first + 1]
    cdef double x, y
    cdef int i, s
    for i in range(sizes[1]):
        x = arena[slots[0] + i]
        c = arena + slots[first]
        for s in range(sections):
            y = c[0] * x + z[0]
            z[0] = c[1] * x - c[3] * y + z[1]
            z[1] = c[2] * x - c[4] * y
            x = y
            c += 5
            z += 2
        arena[slots[1] + i] = x
    return OK


cdef int biquads_settle(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    """The delays of a filter that has seen the present input for ever. rest[3 s]: gain, first and second delay for an input of 1."""
    cdef int first = 2 + slots[PARAMETERS]
    cdef double *rest
    cdef double *z = arena + slots[first + 1]
    cdef double x
    cdef int i, s
    for i in range(sizes[1]):
        x = arena[slots[0] + i] if isfinite(arena[slots[0] + i]) else 0.0
        rest = arena + slots[first + 2]
        for s in range(sizes[first] // 5):
            z[0] = rest[1] * x
            z[1] = rest[2] * x
            x = rest[0] * x
            rest += 3
            z += 2
    return OK


cdef int transfer_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u[n], y[n], b[o + 1], a[o + 1], delays[o n], rest[o]; direct form II transposed, in two steps
    cdef int order = sizes[2] - 1
    cdef double b0 = arena[slots[2]]
    cdef double *z = arena + slots[4]
    cdef int i
    for i in range(sizes[1]):
        if order == 0:
            arena[slots[1] + i] = b0 * arena[slots[0] + i]
        elif b0 == 0.0:
            arena[slots[1] + i] = z[i * order]          # no feedthrough: u is not there yet
        else:
            arena[slots[1] + i] = b0 * arena[slots[0] + i] + z[i * order]
    return OK


cdef int transfer_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef int order = sizes[2] - 1
    cdef double *b = arena + slots[2]
    cdef double *a = arena + slots[3]
    cdef double *z = arena + slots[4]
    cdef double u, y
    cdef int i, k
    for i in range(sizes[1]):
        u = arena[slots[0] + i]
        y = arena[slots[1] + i]
        for k in range(order):
            z[k] = b[k + 1] * u - a[k + 1] * y + (z[k + 1] if k + 1 < order else 0.0)
        z += order
    return OK


cdef int transfer_settle(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    """The delays of a system that has seen the present input for ever."""
    cdef int order = sizes[2] - 1
    cdef double u
    cdef int i, k
    for i in range(sizes[1]):
        u = arena[slots[0] + i] if isfinite(arena[slots[0] + i]) else 0.0
        for k in range(order):
            arena[slots[4] + i * order + k] = arena[slots[5] + k] * u
    return OK


cdef enum: # of StateSpace
    U, Y, A, B, C, D, REST, STATE, FOLLOWING


cdef inline double dot(const double *a, const double *x, int n) noexcept nogil:
    cdef double total = 0.0
    cdef int i
    for i in range(n):
        total += a[i] * x[i]
    return total


cdef int state_space_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    """y = C x + D u; where D is empty, u is not there yet."""
    cdef int n = sizes[STATE]
    cdef int m = sizes[U]
    cdef int i
    for i in range(sizes[Y]):
        arena[slots[Y] + i] = dot(arena + slots[C] + i * n, arena + slots[STATE], n)
        if sizes[D] > 0:
            arena[slots[Y] + i] += dot(arena + slots[D] + i * m, arena + slots[U], m)
    return OK


cdef int state_space_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    """x = A x + B u."""
    cdef int n = sizes[STATE]
    cdef int m = sizes[U]
    cdef double *x = arena + slots[STATE]
    cdef double *following = arena + slots[FOLLOWING]
    cdef int i
    for i in range(n):
        following[i] = dot(arena + slots[A] + i * n, x, n) + dot(arena + slots[B] + i * m, arena + slots[U], m)
    for i in range(n):
        x[i] = following[i]
    return OK


cdef int state_space_settle(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    """x = (I - A)^-1 B u."""
    cdef int i
    for i in range(sizes[U]):
        if not isfinite(arena[slots[U] + i]):
            return OK
    for i in range(sizes[STATE]):
        arena[slots[STATE] + i] = dot(arena + slots[REST] + i * sizes[U], arena + slots[U], sizes[U])
    return OK


biquads = export(biquads_kernel)
biquads_at_rest = export(biquads_settle)
transfer = export(transfer_kernel)
transfer_next = export(transfer_update)
transfer_at_rest = export(transfer_settle)
state_space = export(state_space_kernel)
state_space_next = export(state_space_update)
state_space_at_rest = export(state_space_settle)
