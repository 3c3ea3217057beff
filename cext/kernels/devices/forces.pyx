# cython: freethreading_compatible=True
"""Forces out of what a sensor's amplifier or divider says."""

from libc.math cimport NAN
from libc.stdint cimport int32_t

from cext.abi cimport OK, export
from cext.kernels.limits cimport is_finite
from cext.kernels.devices.taring cimport tared


cdef int load_cell_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # signal, tare, force, capacity, at_capacity, memory: tare
    arena[slots[2]] = tared(arena + slots[5], arena[slots[0]], arena[slots[1]] != 0.0) * arena[slots[3]] / arena[slots[4]]
    return OK


cdef int force_sensitive_resistor_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # voltage, force, pressed, supply, resistor, sensitivity, most, press, release
    cdef double voltage = arena[slots[0]]
    cdef double supply = arena[slots[3]]
    cdef double most = arena[slots[6]]
    cdef double force
    if not is_finite(voltage):
        arena[slots[1]] = NAN
        return OK
    if voltage <= 0.0:
        force = 0.0
    elif voltage >= supply:
        force = most
    else:
        force = arena[slots[5]] * voltage / (arena[slots[4]] * (supply - voltage))
        force = most if force > most else force
    arena[slots[1]] = force
    arena[slots[2]] = force > arena[slots[8]] if arena[slots[2]] != 0.0 else force >= arena[slots[7]]
    return OK


load_cell = export(load_cell_kernel)
force_sensitive_resistor = export(force_sensitive_resistor_kernel)
