"""What CubeMars boards report in extended frames: V3.0 boards always, V1 and V2 in servo mode. Big-endian, as all of that family.

    0x29   status: position int16 x 0.1°, speed int16 x 10 electrical revolutions a minute, current int16 x 0.01 A, temperature int8 °C,
           error
    0x2A   position once more, where the board has been set to send it
    0x2C   FA FB FC FD: its power has just come

An identifier is (kind << 8) | id. The error of a status may be 0x77, DISABLED: the answer to a disable. (AKA Series Product Manual V3.0.0.)

`scales` has, at the joint: rad and rad/s of a code, N·m of an ampere. `notice` is one number: what has happened to a drive that was
commanded.
"""

from libc.math cimport floor
from libc.stdint cimport int8_t, int16_t, int32_t, uint8_t, uint16_t, uint32_t

from cext.abi cimport AUTHORITY, COMMANDED, EXTENDED, FOREIGN, ID_MASK, MALFORMED, MOVING, NOTED, TAKEN, Frame

cdef enum: # kinds of frames
    DUTY, CURRENT, BRAKE, SPEED, POSITION, ORIGIN, POSITION_SPEED, FORCE = 8, DISABLE = 15, CONFIGURE
    STATUS = 0x29, EXTENDED_POSITION, POWER_UP = 0x2C

cdef enum:
    DISABLED = 0x77
    QUIET = 32                  # codes of current, 0.32 A: a drive with less than this is at rest

cdef struct Status:             # of the joint
    double position             # rad, without the offset
    double velocity             # rad/s
    double current              # A, the way the joint turns
    double torque               # N·m
    double temperature          # °C
    double fault


cdef inline int16_t word(const uint8_t *data) noexcept nogil:
    return <int16_t>(<uint16_t>(data[0] << 8 | data[1]))


cdef inline int read_frame(
        double *arena, const Frame *frame, uint32_t id, double sign, const double *scales, double *notice, Status *status) noexcept nogil:
    """What decode says of a frame; a status is read into `status` where it is TAKEN or MOVING.

    A drive that is commanded must not say that it was disabled, or that its power has just come: it would go on with the next command.
    """
    cdef uint32_t kind = (frame.id & <uint32_t>ID_MASK) >> 8
    cdef int16_t current
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED or (frame.id & 0xFF) != id:
        return FOREIGN
    if kind <= CONFIGURE:
        return COMMANDED        # by somebody else: we do not hear ourselves
    if arena[AUTHORITY] == 0.0:
        notice[0] = 0.0
    if kind == POWER_UP:
        if frame.length != 4:
            return MALFORMED
        if arena[AUTHORITY] > 0.0:
            notice[0] = POWER_UP
        return NOTED
    if kind == EXTENDED_POSITION:
        return NOTED            # its unit is 0.0001° or 0.01°, as sources disagree; the status has it too
    if kind != STATUS:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if frame.data[7] == DISABLED and arena[AUTHORITY] > 0.0:
        notice[0] = DISABLED
    current = word(&frame.data[4])
    status.position = sign * scales[0] * word(&frame.data[0])
    status.velocity = sign * scales[1] * word(&frame.data[2])
    status.current = sign * 0.01 * current
    status.torque = scales[2] * status.current
    status.temperature = <int8_t>frame.data[6]
    status.fault = notice[0] if frame.data[7] == 0 or frame.data[7] == DISABLED else frame.data[7]
    return TAKEN if -QUIET <= current < QUIET or frame.data[7] == DISABLED else MOVING


cdef inline void put_word(uint8_t *data, double x) noexcept nogil:
    """The nearest code; what is beyond is the last."""
    cdef double nearest = floor(x + 0.5)
    cdef uint16_t code = <uint16_t><int16_t>(32767.0 if nearest > 32767.0 else nearest if nearest > -32768.0 else -32768.0)
    data[0] = <uint8_t>(code >> 8)
    data[1] = <uint8_t>code


cdef inline void put_long(uint8_t *data, int32_t value) noexcept nogil:
    cdef uint32_t code = <uint32_t>value
    data[0] = <uint8_t>(code >> 24)
    data[1] = <uint8_t>(code >> 16)
    data[2] = <uint8_t>(code >> 8)
    data[3] = <uint8_t>code


cdef inline int32_t get_long(const uint8_t *data) noexcept nogil:
    return <int32_t>(<uint32_t>data[0] << 24 | <uint32_t>data[1] << 16 | <uint32_t>data[2] << 8 | data[3])
