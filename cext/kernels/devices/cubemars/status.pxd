"""Reports of CubeMars boards in extended frames: V3.0 boards in all modes, V1 and V2 in servo mode. Big-endian.

    0x29   status: position int16 x 0.1°, speed int16 x 10 electrical revolutions per minute, current int16 x 0.01 A,
           temperature int8 °C, error
    0x2A   position again, if the board is configured to send it
    0x2C   FA FB FC FD: the board has just been powered on

An identifier is (kind << 8) | id. Error 0x77, DISABLED, in a status answers a disable. (AKA Series Product Manual
V3.0.0)

`scales` contains, at the joint: rad and rad/s per code, N·m per ampere. `notice` is one number: the event reported by a
commanded drive.
"""

from libc.math cimport floor
from libc.stdint cimport int8_t, int16_t, int32_t, uint8_t, uint16_t, uint32_t

from cext.abi cimport AUTHORITY, COMMANDED, EXTENDED, FOREIGN, IDLE, ID_MASK, MALFORMED, NOTED, TAKEN, Frame

cdef enum: # kinds of frames
    DUTY, CURRENT, BRAKE, SPEED, POSITION, ORIGIN, POSITION_SPEED, FORCE = 8, DISABLE = 15, CONFIGURE
    STATUS = 0x29, EXTENDED_POSITION, POWER_UP = 0x2C

cdef enum:
    DISABLED = 0x77

cdef struct Status:             # status of the joint
    double position             # rad, without the offset
    double velocity             # rad/s
    double current              # A, in the joint's direction
    double torque               # N·m
    double temperature          # °C
    double fault


cdef inline int16_t word(const uint8_t *data) noexcept nogil:
    return <int16_t>(<uint16_t>(data[0] << 8 | data[1]))


cdef inline int read_frame(
        double *arena, const Frame *frame, uint32_t id, double sign, const double *scales, double *notice,
        Status *status) noexcept nogil:
    """Return the result of decoding a frame. For TAKEN and IDLE, `status` receives the status.

    A commanded drive that reports a disable or a power-on sets `notice`: it would not obey the next command safely.
    """
    cdef uint32_t kind = (frame.id & <uint32_t>ID_MASK) >> 8
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED or (frame.id & 0xFF) != id:
        return FOREIGN
    if kind <= CONFIGURE:
        return COMMANDED        # by another controller: frames of this run are not received
    if arena[AUTHORITY] == 0.0:
        notice[0] = 0.0
    if kind == POWER_UP:
        if frame.length != 4:
            return MALFORMED
        if arena[AUTHORITY] > 0.0:
            notice[0] = POWER_UP
        return NOTED
    if kind == EXTENDED_POSITION:
        return NOTED            # sources disagree on its unit, 0.0001° or 0.01°; the status also contains the position
    if kind != STATUS:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if frame.data[7] == DISABLED and arena[AUTHORITY] > 0.0:
        notice[0] = DISABLED
    status.position = sign * scales[0] * word(&frame.data[0])
    status.velocity = sign * scales[1] * word(&frame.data[2])
    status.current = sign * 0.01 * word(&frame.data[4])
    status.torque = scales[2] * status.current
    status.temperature = <int8_t>frame.data[6]
    status.fault = notice[0] if frame.data[7] == 0 or frame.data[7] == DISABLED else frame.data[7]
    return IDLE if frame.data[7] == DISABLED else TAKEN


cdef inline void put_word(uint8_t *data, double x) noexcept nogil:
    """Write the nearest code, clamped to 16 bits."""
    cdef double nearest = floor(x + 0.5)
    cdef uint16_t code = <uint16_t><int16_t>(32767.0 if nearest > 32767.0 else nearest if nearest > -32768.0
        else -32768.0)
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
