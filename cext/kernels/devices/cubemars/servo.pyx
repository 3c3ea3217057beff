# cython: freethreading_compatible=True
"""CubeMars boards of all generations in servo mode: encoding of frames, for the driver.

One command per mode, in extended frames.

    identifier   (kind << 8) | id

    0 duty int32 x 1e-5
    1 current int32 mA
    2 braking current int32 mA
    3 speed int32, electrical revolutions per minute
    4 position int32 x 1e-4°
    6 position as 4, speed int16 x 10, acceleration int16 x 10 per second

Big-endian. A command has no reply; cext/kernels/devices/cubemars/status.pxd describes the drive's own reports. Codes
are truncated towards zero, so that no sent value exceeds its command. (AK Series Module Driver Manual V1.0.18.)
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    AUTHORITY, EXTENDED, IDLE, ITEMS, NOTED, NOT_FINITE, OUT_OF_LIMITS, TAKEN, Frame, decode_t, encode_t,
    export_decode, export_encode, items,
)
from cext.kernels.devices.cubemars.status cimport BRAKE, Status, put_long, put_word, read_frame
from cext.kernels.devices.cubemars.status cimport POSITION as GO_TO, POSITION_SPEED as GO_TO_AT


cdef struct Drive:
    int32_t position, velocity, torque, current, temperature, fault, can_id, invert, offset
    int32_t scales, notice      # see cext/kernels/devices/cubemars/status.pxd

DRIVE = items((<Drive *>ITEMS)[0], "scales[3]")

cdef struct Command:
    int32_t command             # input of the mode
    int32_t sent                # output with the value sent
    int32_t position, can_id, invert, offset
    int32_t limits              # lowest and highest command; fraction of it that the drive monitor permits
    # kind of the command, codes per unit at the joint, largest code, speed and acceleration as sent
    int32_t written

COMMAND = items((<Command *>ITEMS)[0], "limits[3] written[5]")


cdef int servo_decode(double *arena, const Drive *at, const Drive *sizes, const Frame *frame) noexcept nogil:
    cdef double *notice = arena + at.notice
    cdef double sign = -1.0 if arena[at.invert] != 0.0 else 1.0
    cdef Status status
    cdef int answer = read_frame(arena, frame, <uint32_t>arena[at.can_id], sign, arena + at.scales, notice, &status)
    if answer == NOTED and notice[0] != 0.0:
        arena[at.fault] = notice[0]
    if answer != TAKEN and answer != IDLE:
        return answer
    arena[at.position] = status.position - arena[at.offset]
    arena[at.velocity] = status.velocity
    arena[at.current] = status.current
    arena[at.torque] = status.torque
    arena[at.temperature] = status.temperature
    arena[at.fault] = status.fault
    return answer


cdef int servo_encode(double *arena, const Command *at, const Command *sizes, Frame *frames) noexcept nogil:
    """Encode the command. During fade-in, a position is interpolated from the present one; others are scaled."""
    cdef double *limits = arena + at.limits
    cdef double *written = arena + at.written
    cdef uint32_t kind = <uint32_t>written[0]
    cdef bint goes = kind == GO_TO or kind == GO_TO_AT
    cdef double sign = -1.0 if arena[at.invert] != 0.0 and kind != BRAKE else 1.0
    cdef double shift = arena[at.offset] if goes else 0.0
    cdef double share = arena[AUTHORITY]
    cdef double command = arena[at.command]
    cdef double code
    if not isfinite(command):
        return -NOT_FINITE
    if not limits[0] <= command <= limits[1] or not 0.0 <= share <= 1.0 or not 0.0 <= limits[2] <= 1.0:
        return -OUT_OF_LIMITS   # also NaN
    if goes:
        command = arena[at.position] + share * (command - arena[at.position]) if share < 1.0 else command
    else:
        command *= share * limits[2]
    code = sign * (command + shift) * written[1]
    code = written[2] if code > written[2] else -written[2] if code < -written[2] else code
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>EXTENDED | kind << 8 | <uint32_t>arena[at.can_id]
    frames[0].length = 4
    put_long(frames[0].data, <int32_t>code)
    if kind == GO_TO_AT:
        frames[0].length = 8
        put_word(&frames[0].data[4], written[3])
        put_word(&frames[0].data[6], written[4])
    arena[at.sent] = sign * <int32_t>code / written[1] - shift
    return 1


decode = export_decode(<decode_t>servo_decode, DRIVE)
encode = export_encode(<encode_t>servo_encode, COMMAND)
