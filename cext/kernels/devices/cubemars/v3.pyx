# cython: freethreading_compatible=True
"""CubeMars V3.0 boards in force control: encoding of frames, for the driver.

    command    kp12 kd12 p16 v12 t12, most significant bit first, in the extended frame (8 << 8) | id
    disable    an empty frame, (15 << 8) | id
    reply      the status of cext/kernels/devices/cubemars/status.pxd, periodic or per command, as configured on the
    board

AKA Series Product Manual V3.0.0, AK Series Product Manual V3.2.0. Codes are truncated and clamped, as in MIT mode.
"""

from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    EXTENDED, IDLE, ITEMS, NOTED, OK, TAKEN, Frame, decode_t, encode_t, export_decode, export_encode, items,
)
from cext.kernels.devices.cubemars.status cimport FORCE, Status, read_frame
from cext.kernels.devices.mit cimport Codes, Mit, all_ones, mit_sizes, quantise

cdef struct ForceControl:
    Mit mit
    int32_t current, scales, notice     # last two: see cext/kernels/devices/cubemars/status.pxd

FORCE_CONTROL = items((<ForceControl *>ITEMS)[0], mit_sizes() + " scales[3]")


cdef int v3_decode(double *arena, const ForceControl *at, const ForceControl *sizes, const Frame *frame) noexcept nogil:
    cdef double sign = -1.0 if arena[at.mit.invert] != 0.0 else 1.0
    cdef Status status
    cdef int answer = read_frame(
        arena, frame, <uint32_t>arena[at.mit.can_id], sign, arena + at.scales, arena + at.notice, &status)
    if answer == NOTED and arena[at.notice] != 0.0:
        arena[at.mit.fault] = arena[at.notice]
    if answer != TAKEN and answer != IDLE:
        return answer
    arena[at.mit.position] = status.position - arena[at.mit.offset]
    arena[at.mit.velocity] = status.velocity
    arena[at.current] = status.current
    arena[at.mit.torque] = status.torque
    arena[at.mit.temperature] = status.temperature
    arena[at.mit.fault] = status.fault
    return answer


cdef int v3_encode(double *arena, const ForceControl *at, const ForceControl *sizes, Frame *frames) noexcept nogil:
    cdef double *wire = arena + at.mit.wire
    cdef double *scales = arena + at.scales
    cdef uint8_t *data = frames[0].data
    cdef Codes codes
    cdef int status = quantise(
        arena, &at.mit, max(2.0 * wire[0] / 0xFFFF, scales[0]), max(2.0 * wire[1] / 0xFFF, scales[1]), &codes)
    if status != OK:
        return -status
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>EXTENDED | FORCE << 8 | <uint32_t>arena[at.mit.can_id]
    frames[0].length = 8
    data[0] = <uint8_t>(codes.stiffness >> 4)
    data[1] = <uint8_t>((codes.stiffness & 15) << 4 | codes.damping >> 8)
    data[2] = <uint8_t>codes.damping
    data[3] = <uint8_t>(codes.position >> 8)
    data[4] = <uint8_t>codes.position
    data[5] = <uint8_t>(codes.velocity >> 4)
    data[6] = <uint8_t>((codes.velocity & 15) << 4 | codes.torque >> 8)
    data[7] = <uint8_t>codes.torque
    if all_ones(data, 7) and data[7] >= 0xFC:
        # all ranges at their top may encode enable: reduce the position by one code
        data[4] -= 1
    return 1


decode = export_decode(<decode_t>v3_decode, FORCE_CONTROL)
encode = export_encode(<encode_t>v3_encode, FORCE_CONTROL)
