# cython: freethreading_compatible=True
"""Thermal models of motors."""

from libc.math cimport NAN
from libc.stdint cimport int32_t

from cext.abi cimport DT, ITEMS, OK, export, items, kernel_t

cdef struct TwoNodes:
    int32_t torque, ambient, winding, case, winding_capacity, winding_resistance, case_capacity, case_resistance
    int32_t heat, held, state, begun

TWO_NODES = items((<TwoNodes *>ITEMS)[0], "held[2] state[2]")


cdef int two_nodes_kernel(double *arena, const TwoNodes *at, const TwoNodes *sizes) noexcept nogil:
    cdef double *state = arena + at.state
    cdef double torque = arena[at.held]
    cdef double ambient = arena[at.held + 1]
    cdef double h = arena[DT]
    cdef double a, b, c, w, e, determinant
    if state[0] != state[0]:
        state[0] = state[1] = arena[at.ambient]
    elif arena[at.begun] != 0.0:
        if torque * ambient - torque * ambient != 0.0:
            arena[at.winding] = arena[at.case] = NAN
            return OK
        # 1. Heat flow per step, divided by the heat capacity of each node.
        a = h / (arena[at.winding_capacity] * arena[at.winding_resistance])
        b = h / (arena[at.case_capacity] * arena[at.winding_resistance])
        c = h / (arena[at.case_capacity] * arena[at.case_resistance])
        # 2. Backward Euler: (1 + a) w' - a e' = w + heat, (1 + b + c) e' - b w' = e + c ambient.
        w = state[0] + h / arena[at.winding_capacity] * (
            arena[at.heat] * (torque * torque) * (1.0 + 0.00393 * (state[0] - 25.0)))
        e = state[1] + c * ambient
        determinant = 1.0 + b + c + a * (1.0 + c)
        state[0] = ((1.0 + b + c) * w + a * e) / determinant
        state[1] = ((1.0 + a) * e + b * w) / determinant
    arena[at.begun] = 1.0
    arena[at.winding] = state[0]
    arena[at.case] = state[1]
    return OK


cdef int two_nodes_update(double *arena, const TwoNodes *at, const TwoNodes *sizes) noexcept nogil:
    arena[at.held] = arena[at.torque]
    arena[at.held + 1] = arena[at.ambient]
    return OK


two_nodes = export(<kernel_t>two_nodes_kernel, TWO_NODES)
two_nodes_next = export(<kernel_t>two_nodes_update, TWO_NODES)
