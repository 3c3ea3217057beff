# cython: freethreading_compatible=True
"""Heat in motors."""

from libc.math cimport NAN
from libc.stdint cimport int32_t

from cext.abi cimport DT, OK, export

cdef enum: # of ThermalModel
    TORQUE, AMBIENT, WINDING, CASE
    RATED, LOSS, WINDING_CAPACITY, WINDING_RESISTANCE, CASE_CAPACITY, CASE_RESISTANCE, START
    HEAT, HELD, STATE, BEGUN


cdef int two_nodes_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double *state = arena + slots[STATE]
    cdef double torque = arena[slots[HELD]]
    cdef double ambient = arena[slots[HELD] + 1]
    cdef double h = arena[DT]
    cdef double a, b, c, w, e, determinant
    if state[0] != state[0]:
        state[0] = state[1] = arena[slots[AMBIENT]]
    elif arena[slots[BEGUN]] != 0.0:
        if torque * ambient - torque * ambient != 0.0:
            arena[slots[WINDING]] = arena[slots[CASE]] = NAN
            return OK
        # 1. What flows in a step, over what each node holds.
        a = h / (arena[slots[WINDING_CAPACITY]] * arena[slots[WINDING_RESISTANCE]])
        b = h / (arena[slots[CASE_CAPACITY]] * arena[slots[WINDING_RESISTANCE]])
        c = h / (arena[slots[CASE_CAPACITY]] * arena[slots[CASE_RESISTANCE]])
        # 2. Backward Euler: (1 + a) w' - a e' = w + heat, (1 + b + c) e' - b w' = e + c ambient.
        w = state[0] + h / arena[slots[WINDING_CAPACITY]] * (
            arena[slots[HEAT]] * (torque * torque) * (1.0 + 0.00393 * (state[0] - 25.0)))
        e = state[1] + c * ambient
        determinant = 1.0 + b + c + a * (1.0 + c)
        state[0] = ((1.0 + b + c) * w + a * e) / determinant
        state[1] = ((1.0 + a) * e + b * w) / determinant
    arena[slots[BEGUN]] = 1.0
    arena[slots[WINDING]] = state[0]
    arena[slots[CASE]] = state[1]
    return OK


cdef int two_nodes_update(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    arena[slots[HELD]] = arena[slots[TORQUE]]
    arena[slots[HELD] + 1] = arena[slots[AMBIENT]]
    return OK


two_nodes = export(two_nodes_kernel)
two_nodes_next = export(two_nodes_update)
