# cython: freethreading_compatible=True
"""Forces from the signal of a sensor's amplifier or voltage divider."""

from libc.math cimport NAN
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport is_finite
from cext.kernels.devices.taring cimport tared


cdef struct LoadCell:
    int32_t signal, tare, force, capacity, at_capacity, taring

LOAD_CELL = items((<LoadCell *>ITEMS)[0], "taring[6]")


cdef int load_cell_kernel(double *arena, const LoadCell *at, const LoadCell *sizes) noexcept nogil:
    arena[at.force] = tared(arena + at.taring, arena[at.signal],
        arena[at.tare] != 0.0) * arena[at.capacity] / arena[at.at_capacity]
    return OK


cdef struct EmulatedCell:
    int32_t force, signal, capacity, at_capacity, zero

EMULATED_CELL = items((<EmulatedCell *>ITEMS)[0])


cdef int emulated_load_cell_kernel(double *arena, const EmulatedCell *at, const EmulatedCell *sizes) noexcept nogil:
    arena[at.signal] = arena[at.zero] + arena[at.force] * arena[at.at_capacity] / arena[at.capacity]
    return OK


cdef struct Resistor:
    int32_t voltage, force, pressed, supply, resistor, sensitivity, most, press, release

RESISTOR = items((<Resistor *>ITEMS)[0])


cdef int force_sensitive_resistor_kernel(double *arena, const Resistor *at, const Resistor *sizes) noexcept nogil:
    cdef double voltage = arena[at.voltage]
    cdef double supply = arena[at.supply]
    cdef double most = arena[at.most]
    cdef double force
    if not is_finite(voltage):
        arena[at.force] = NAN
        return OK
    if voltage <= 0.0:
        force = 0.0
    elif voltage >= supply:
        force = most
    else:
        force = arena[at.sensitivity] * voltage / (arena[at.resistor] * (supply - voltage))
        force = most if force > most else force
    arena[at.force] = force
    arena[at.pressed] = force > arena[at.release] if arena[at.pressed] != 0.0 else force >= arena[at.press]
    return OK


cdef struct Divider:
    int32_t force, voltage, supply, resistor, sensitivity

DIVIDER = items((<Divider *>ITEMS)[0])


cdef int resistor_divider_kernel(double *arena, const Divider *at, const Divider *sizes) noexcept nogil:
    cdef double force = arena[at.force]
    if not is_finite(force):
        arena[at.voltage] = NAN
    elif force <= 0.0:
        arena[at.voltage] = 0.0
    else:
        arena[at.voltage] = arena[at.supply] / (1.0 + arena[at.sensitivity] / force / arena[at.resistor])
    return OK


load_cell = export(<kernel_t>load_cell_kernel, LOAD_CELL)
emulated_load_cell = export(<kernel_t>emulated_load_cell_kernel, EMULATED_CELL)
force_sensitive_resistor = export(<kernel_t>force_sensitive_resistor_kernel, RESISTOR)
resistor_divider = export(<kernel_t>resistor_divider_kernel, DIVIDER)
