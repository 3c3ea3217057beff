# cython: freethreading_compatible=True
"""CubeMars boards of all generations in servo mode: the bytes on the wire, for the driver. One command a mode, in extended frames.

    identifier   (kind << 8) | id

    0 duty int32 x 1e-5 · 1 current int32 mA · 2 braking current int32 mA · 3 speed int32, electrical revolutions a minute
    4 position int32 x 1e-4° · 6 position as 4, speed int16 x 10, acceleration int16 x 10 a second

Big-endian. A command has no reply: cext/kernels/devices/cubemars/status.pxd has what the drive reports by itself. (AK Series Module Driver Manual
V1.0.18.) A code is truncated towards zero, so that nothing is sent beyond what was commanded.
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t, uint32_t
from libc.string cimport memset

from cext.abi cimport AUTHORITY, EXTENDED, INPUTS, MOVING, NOTED, NOT_FINITE, OUT_OF_LIMITS, TAKEN, Frame, export_decode, export_encode
from cext.kernels.devices.cubemars.status cimport BRAKE, Status, put_long, put_word, read_frame
from cext.kernels.devices.cubemars.status cimport POSITION as GO_TO, POSITION_SPEED as GO_TO_AT
from cext.kernels.devices.mit cimport memory_of

cdef enum: # behind the one input
    POSITION, VELOCITY, TORQUE, CURRENT, TEMPERATURE, FAULT, AGE, SENT
    CAN_ID, INVERT, OFFSET

cdef enum: # memory
    SCALES, NOTICE
    LIMITS                      # lowest and highest command, and the share that the watch leaves of it
    WRITTEN                     # kind of the command, codes of its unit at the joint, largest code, speed and acceleration as they are sent


cdef int servo_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef const int32_t *own = slots + slots[INPUTS]
    cdef int memory = memory_of(slots)
    cdef double *notice = arena + slots[memory + NOTICE]
    cdef double sign = -1.0 if arena[own[INVERT]] != 0.0 else 1.0
    cdef Status status
    cdef int answer = read_frame(arena, frame, <uint32_t>arena[own[CAN_ID]], sign, arena + slots[memory + SCALES], notice, &status)
    if answer == NOTED and notice[0] != 0.0:
        arena[own[FAULT]] = notice[0]
    if answer != TAKEN and answer != MOVING:
        return answer
    arena[own[POSITION]] = status.position - arena[own[OFFSET]]
    arena[own[VELOCITY]] = status.velocity
    arena[own[CURRENT]] = status.current
    arena[own[TORQUE]] = status.torque
    arena[own[TEMPERATURE]] = status.temperature
    arena[own[FAULT]] = status.fault
    return answer


cdef int servo_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """While commands fade in, a position is that share of the way from where the joint is; of all others that share is sent."""
    cdef const int32_t *own = slots + slots[INPUTS]
    cdef int memory = memory_of(slots)
    cdef double *limits = arena + slots[memory + LIMITS]
    cdef double *written = arena + slots[memory + WRITTEN]
    cdef uint32_t kind = <uint32_t>written[0]
    cdef bint goes = kind == GO_TO or kind == GO_TO_AT
    cdef double sign = -1.0 if arena[own[INVERT]] != 0.0 and kind != BRAKE else 1.0
    cdef double shift = arena[own[OFFSET]] if goes else 0.0
    cdef double share = arena[AUTHORITY]
    cdef double command = arena[slots[0]]
    cdef double code
    if not isfinite(command):
        return -NOT_FINITE
    if not limits[0] <= command <= limits[1] or not 0.0 <= share <= 1.0 or not 0.0 <= limits[2] <= 1.0:
        return -OUT_OF_LIMITS   # a share of NaN would be anything
    if goes:
        command = arena[own[POSITION]] + share * (command - arena[own[POSITION]]) if share < 1.0 else command
    else:
        command *= share * limits[2]
    code = sign * (command + shift) * written[1]
    code = written[2] if code > written[2] else -written[2] if code < -written[2] else code
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>EXTENDED | kind << 8 | <uint32_t>arena[own[CAN_ID]]
    frames[0].length = 4
    put_long(frames[0].data, <int32_t>code)
    if kind == GO_TO_AT:
        frames[0].length = 8
        put_word(&frames[0].data[4], written[3])
        put_word(&frames[0].data[6], written[4])
    arena[own[SENT]] = sign * <int32_t>code / written[1] - shift
    return 1


decode = export_decode(servo_decode)
encode = export_encode(servo_encode)
