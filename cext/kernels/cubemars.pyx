# cython: freethreading_compatible=True
"""CubeMars AK in MIT mode: the bytes on the wire, for the driver and for the emulated drive.

    command    p16 v12 kp12 kd12 t12, most significant bit first, to the drive's id
    special    FF FF FF FF FF FF FF FC enable, FD disable, FE this position is zero
    reply      id p16 v12 t12 temperature error, from the drive's id or from 0; temperature in °C + 40

AK Series Module Driver Manual V1.0.18, pages 64 to 68. A code is (x - low) (2^n - 1) / (high - low), truncated and
clamped: the manual's 2^n wraps at the top, where +12.5 rad would become -12.5 rad.
"""

from libc.math cimport fabs, isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    AUTHORITY, FOREIGN, FRAMES_PER_DEVICE, MALFORMED, NOT_FINITE, OK, OUT_OF_LIMITS, PERIOD, TAKEN, Frame, export, export_decode,
    export_encode,
)
from cext.kernels.drive_law cimport Law, share_inside

cdef enum: # of CubeMars, in the order of its declaration
    POSITION_COMMAND, VELOCITY_COMMAND, TORQUE_COMMAND, STIFFNESS_COMMAND, DAMPING_COMMAND
    POSITION, VELOCITY, TORQUE, TEMPERATURE, FAULT, AGE, TORQUE_SENT, LIMITED
    CAN_ID, INVERT, OFFSET, TIMEOUT, STOP_DAMPING, STOP_TIME
    WIRE                        # position, velocity, stiffness, damping, torque: half the range of each
    LIMITS                      # position, velocity, stiffness, damping, torque: what a command must stay inside; torque of the whole law

cdef enum: # of EmulatedCubeMars
    E_POSITION, E_VELOCITY, E_TEMPERATURE, E_FAULT
    E_TORQUE, E_ENABLED
    E_CAN_ID, E_INVERT, E_OFFSET, E_PEAK
    E_WIRE
    E_COMMAND                   # position, velocity, stiffness, damping, torque as last commanded, at the motor
    E_STATE                     # enabled, replies due, zero of the encoder


cdef inline uint32_t to_code(double x, double low, double high, int bits) noexcept nogil:
    cdef uint32_t top = (1 << bits) - 1
    if not x > low:
        return 0
    if x >= high:
        return top
    return <uint32_t>((x - low) * top / (high - low))


cdef inline double from_code(uint32_t code, double low, double high, int bits) noexcept nogil:
    return low + code * (high - low) / ((1 << bits) - 1)


cdef inline void pack(uint8_t *data, uint32_t p, uint32_t v, uint32_t kp, uint32_t kd, uint32_t t) noexcept nogil:
    data[0] = <uint8_t>(p >> 8)
    data[1] = <uint8_t>p
    data[2] = <uint8_t>(v >> 4)
    data[3] = <uint8_t>((v & 15) << 4 | kp >> 8)
    data[4] = <uint8_t>kp
    data[5] = <uint8_t>(kd >> 4)
    data[6] = <uint8_t>((kd & 15) << 4 | t >> 8)
    data[7] = <uint8_t>t


cdef bint is_special(const uint8_t *data) noexcept nogil:
    cdef int i
    for i in range(7):
        if data[i] != 0xFF:
            return False
    return data[7] >= 0xFC and data[7] <= 0xFE


cdef int cubemars_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t id = <uint32_t>arena[slots[CAN_ID]]
    cdef double *wire = arena + slots[WIRE]
    cdef double sign = -1.0 if arena[slots[INVERT]] != 0.0 else 1.0
    cdef const uint8_t *data = frame.data
    if frame.id != id and (frame.id != 0 or frame.length == 0 or data[0] != id):
        return FOREIGN          # an extended, remote or error frame differs in its high bits
    if frame.length != 8 or data[0] != id:
        return MALFORMED
    arena[slots[POSITION]] = sign * from_code(<uint32_t>data[1] << 8 | data[2], -wire[0], wire[0], 16) - arena[slots[OFFSET]]
    arena[slots[VELOCITY]] = sign * from_code(<uint32_t>data[3] << 4 | data[4] >> 4, -wire[1], wire[1], 12)
    arena[slots[TORQUE]] = sign * from_code((<uint32_t>data[4] & 15) << 8 | data[5], -wire[4], wire[4], 12)
    arena[slots[TEMPERATURE]] = <double>data[6] - 40.0
    arena[slots[FAULT]] = data[7]
    return TAKEN


cdef double law_share(
        double *arena, const int32_t *slots, double position, double velocity, double stiffness, double damping, double torque) noexcept nogil:
    """The share of stiffness and damping that keeps the drive's law inside the torque limit until the next frame; 0 on stale feedback."""
    cdef double *wire = arena + slots[WIRE]
    cdef double age = arena[slots[AGE]]
    cdef double position_error = position - arena[slots[POSITION]]
    cdef double velocity_error = velocity - arena[slots[VELOCITY]]
    cdef double moves = fabs(arena[slots[VELOCITY]]) * (arena[PERIOD] + age)
    cdef Law law
    if not age <= 2.0 * arena[PERIOD] + 1e-9:
        return 0.0
    law.spring, law.damper, law.torque = stiffness * position_error, damping * velocity_error, torque
    law.spread = stiffness * (moves + 4.0 * wire[0] / 0xFFFF) + damping * 4.0 * wire[1] / 0xFFF     # a code of ours, and one of the reply
    law.spring_loss = (fabs(position_error) + moves) * wire[2] / 0xFFF
    law.damper_loss = fabs(velocity_error) * wire[3] / 0xFFF
    return share_inside(&law, arena[slots[LIMITS] + 5])


cdef int cubemars_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *wire = arena + slots[WIRE]
    cdef double *limits = arena + slots[LIMITS]
    cdef double sign = -1.0 if arena[slots[INVERT]] != 0.0 else 1.0
    cdef double share = arena[AUTHORITY]
    cdef double position = arena[slots[POSITION_COMMAND]]
    cdef double velocity = arena[slots[VELOCITY_COMMAND]]
    cdef double stiffness = arena[slots[STIFFNESS_COMMAND]]
    cdef double damping = arena[slots[DAMPING_COMMAND]]
    cdef double torque = arena[slots[TORQUE_COMMAND]]
    cdef double felt
    cdef uint32_t code
    if not (isfinite(position) and isfinite(velocity) and isfinite(stiffness) and isfinite(damping) and isfinite(torque)):
        return -NOT_FINITE
    if (not -limits[0] <= position <= limits[0] or not -limits[1] <= velocity <= limits[1] or not 0.0 <= stiffness <= limits[2]
            or not 0.0 <= damping <= limits[3] or not -limits[4] <= torque <= limits[4]):
        return -OUT_OF_LIMITS
    if not 0.0 <= share <= 1.0:
        return -OUT_OF_LIMITS   # a share of NaN would be full torque
    if stiffness > 0.0 or damping > 0.0:
        felt = law_share(arena, slots, position, velocity, stiffness, damping, torque)
        arena[slots[LIMITED]] += felt < 1.0
        stiffness *= felt
        damping *= felt
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>arena[slots[CAN_ID]]
    frames[0].length = 8
    code = to_code(sign * share * torque, -wire[4], wire[4], 12)
    pack(
        frames[0].data,
        to_code(sign * (position + arena[slots[OFFSET]]), -wire[0], wire[0], 16),
        to_code(sign * velocity, -wire[1], wire[1], 12),
        to_code(share * stiffness, 0.0, wire[2], 12),
        to_code(share * damping, 0.0, wire[3], 12),
        code,
    )
    if is_special(frames[0].data):
        frames[0].data[1] -= 1  # every range at its top reads as enable, disable or zero: one code less of position does not
    arena[slots[TORQUE_SENT]] = sign * from_code(code, -wire[4], wire[4], 12)
    return 1


cdef int emulated_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef double *wire = arena + slots[E_WIRE]
    cdef double *command = arena + slots[E_COMMAND]
    cdef double *state = arena + slots[E_STATE]
    cdef const uint8_t *data = frame.data
    if frame.id != <uint32_t>arena[slots[E_CAN_ID]]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if is_special(data):
        if data[7] == 0xFC:
            state[0] = 1.0
        elif data[7] == 0xFD:
            state[0] = 0.0
            memset(command, 0, 5 * sizeof(double))
        else:
            state[2] = motor_position(arena, slots)
    elif state[0] != 0.0:
        command[0] = from_code(<uint32_t>data[0] << 8 | data[1], -wire[0], wire[0], 16)
        command[1] = from_code(<uint32_t>data[2] << 4 | data[3] >> 4, -wire[1], wire[1], 12)
        command[2] = from_code((<uint32_t>data[3] & 15) << 8 | data[4], 0.0, wire[2], 12)
        command[3] = from_code(<uint32_t>data[5] << 4 | data[6] >> 4, 0.0, wire[3], 12)
        command[4] = from_code((<uint32_t>data[6] & 15) << 8 | data[7], -wire[4], wire[4], 12)
    state[1] += 1.0
    return TAKEN


cdef inline double motor_position(double *arena, const int32_t *slots) noexcept nogil:
    cdef double position = arena[slots[E_POSITION]] + arena[slots[E_OFFSET]]
    return -position if arena[slots[E_INVERT]] != 0.0 else position


cdef inline double motor_torque(double *arena, const int32_t *slots) noexcept nogil:
    """The drive's law, as far as its current goes: kp (p_des - p) + kd (v_des - v) + t."""
    cdef double *command = arena + slots[E_COMMAND]
    cdef double *state = arena + slots[E_STATE]
    cdef double velocity = -arena[slots[E_VELOCITY]] if arena[slots[E_INVERT]] != 0.0 else arena[slots[E_VELOCITY]]
    cdef double torque, peak
    if state[0] == 0.0 or arena[slots[E_FAULT]] != 0.0:
        return 0.0
    torque = command[2] * (command[0] - motor_position(arena, slots) + state[2]) + command[3] * (command[1] - velocity) + command[4]
    peak = arena[slots[E_PEAK]]
    return peak if torque > peak else -peak if torque < -peak else torque


cdef int emulated_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double torque = motor_torque(arena, slots)
    arena[slots[E_TORQUE]] = -torque if arena[slots[E_INVERT]] != 0.0 else torque
    arena[slots[E_ENABLED]] = arena[slots[E_STATE]]
    return OK


cdef int emulated_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """One reply for each frame that was heard, with the state of now."""
    cdef double *wire = arena + slots[E_WIRE]
    cdef double *state = arena + slots[E_STATE]
    cdef double velocity = -arena[slots[E_VELOCITY]] if arena[slots[E_INVERT]] != 0.0 else arena[slots[E_VELOCITY]]
    cdef double position = motor_position(arena, slots) - state[2]
    cdef double torque = motor_torque(arena, slots)
    cdef int count = <int>state[1] if state[1] < FRAMES_PER_DEVICE else FRAMES_PER_DEVICE
    cdef uint32_t p = to_code(position, -wire[0], wire[0], 16)
    cdef uint32_t v = to_code(velocity, -wire[1], wire[1], 12)
    cdef uint32_t t = to_code(torque, -wire[4], wire[4], 12)
    cdef double raw = arena[slots[E_TEMPERATURE]] + 40.0
    cdef uint8_t *data
    cdef int i
    if not (isfinite(position) and isfinite(velocity) and isfinite(torque)):
        return -NOT_FINITE      # a plant that has blown up has no answer
    state[1] = 0.0
    for i in range(count):
        memset(&frames[i], 0, sizeof(Frame))
        frames[i].id = <uint32_t>arena[slots[E_CAN_ID]]
        frames[i].length = 8
        data = frames[i].data
        data[0] = <uint8_t>frames[i].id
        data[1] = <uint8_t>(p >> 8)
        data[2] = <uint8_t>p
        data[3] = <uint8_t>(v >> 4)
        data[4] = <uint8_t>((v & 15) << 4 | t >> 8)
        data[5] = <uint8_t>t
        data[6] = 0 if not raw > 0.0 else 255 if raw > 255.0 else <uint8_t>raw
        data[7] = <uint8_t>arena[slots[E_FAULT]]
    return count


decode = export_decode(cubemars_decode)
encode = export_encode(cubemars_encode)
drive = export(emulated_kernel)
drive_decode = export_decode(emulated_decode)
drive_encode = export_encode(emulated_encode)
