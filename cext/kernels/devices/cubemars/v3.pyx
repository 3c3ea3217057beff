# cython: freethreading_compatible=True
"""CubeMars V3.0 boards in force control: the bytes on the wire, for the driver.

    command    kp12 kd12 p16 v12 t12, most significant bit first, in the extended frame (8 << 8) | id
    disable    an empty frame, (15 << 8) | id
    reply      the status of cext/kernels/devices/cubemars/status.pxd, by itself or to each command, as the board has been set

AKA Series Product Manual V3.0.0, AK Series Product Manual V3.2.0. Codes are truncated and clamped, as in MIT mode.
"""

from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport EXTENDED, MOVING, NOTED, OK, TAKEN, Frame, export_decode, export_encode
from cext.kernels.devices.cubemars.status cimport FORCE, Status, read_frame
from cext.kernels.devices.mit cimport (
    CAN_ID, FAULT, INVERT, LIMITED, OFFSET, POSITION, TEMPERATURE, TORQUE, VELOCITY, Codes, all_ones, memory_of, quantise,
)

cdef enum:
    MORE = 1                    # output behind LIMITED, by which the parameters stand further behind: the current
    CURRENT = LIMITED + 1
    SCALES = 3                  # memory, behind WIRE, LIMITS and SENT
    NOTICE


cdef int v3_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int memory = memory_of(slots)
    cdef double sign = -1.0 if arena[slots[INVERT + MORE]] != 0.0 else 1.0
    cdef Status status
    cdef int answer = read_frame(
        arena, frame, <uint32_t>arena[slots[CAN_ID + MORE]], sign, arena + slots[memory + SCALES], arena + slots[memory + NOTICE], &status)
    if answer == NOTED and arena[slots[memory + NOTICE]] != 0.0:
        arena[slots[FAULT]] = arena[slots[memory + NOTICE]]
    if answer != TAKEN and answer != MOVING:
        return answer
    arena[slots[POSITION]] = status.position - arena[slots[OFFSET + MORE]]
    arena[slots[VELOCITY]] = status.velocity
    arena[slots[CURRENT]] = status.current
    arena[slots[TORQUE]] = status.torque
    arena[slots[TEMPERATURE]] = status.temperature
    arena[slots[FAULT]] = status.fault
    return answer


cdef int v3_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef int memory = memory_of(slots)
    cdef double *wire = arena + slots[memory]
    cdef double *scales = arena + slots[memory + SCALES]
    cdef uint8_t *data = frames[0].data
    cdef Codes codes
    cdef int status = quantise(
        arena, slots, MORE, max(2.0 * wire[0] / 0xFFFF, scales[0]), max(2.0 * wire[1] / 0xFFF, scales[1]), &codes)
    if status != OK:
        return -status
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>EXTENDED | FORCE << 8 | <uint32_t>arena[slots[CAN_ID + MORE]]
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
        data[4] -= 1            # every range at its top may read as enable: one code less of position does not
    return 1


decode = export_decode(v3_decode)
encode = export_encode(v3_encode)
