# cython: freethreading_compatible=True
"""The bytes of the laboratory's drive, for its block and for its emulator: gaitlab/drive/protocol.py."""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    AUTHORITY, FOREIGN, ITEMS, MALFORMED, NOT_FINITE, OK, OUT_OF_LIMITS, TAKEN, Frame, decode_t, encode_t, export,
    export_decode, export_encode, items, kernel_t,
)

cdef enum:
    COMMAND = 0x500
    REPLY = 0x580
    ENABLE = 1
    DISABLE = 2
    TORQUE = 3
    ZERO = 4
    SET_ID = 5

cdef enum: # in `state` of the emulated drive
    OWN_ID, ENABLED, COMMANDED, ZERO_AT, OWED


cdef inline int16_t read16(const uint8_t *data) noexcept nogil:
    return <int16_t>(data[0] | data[1] << 8)


cdef inline void write16(uint8_t *data, double x) noexcept nogil:
    cdef int16_t code = 32767 if x > 32767.0 else -32767 if x < -32767.0 else <int16_t>(x + (0.5 if x > 0.0 else -0.5))
    data[0], data[1] = <uint8_t>code, <uint8_t>(code >> 8)


cdef struct GaitDrive:
    int32_t torque_command, position, velocity, torque, temperature, fault, torque_sent, can_id, limit, gear_ratio

GAIT_DRIVE = items((<GaitDrive *>ITEMS)[0])


cdef int drive_decode(double *arena, const GaitDrive *at, const GaitDrive *sizes, const Frame *frame) noexcept nogil:
    if frame.id != REPLY + <uint32_t>arena[at.can_id]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    arena[at.fault] = frame.data[0] >> 1 & 63
    arena[at.temperature] = frame.data[1] - 40.0
    arena[at.position] = 1e-3 * read16(&frame.data[2]) / arena[at.gear_ratio]
    arena[at.velocity] = 1e-2 * read16(&frame.data[4]) / arena[at.gear_ratio]
    arena[at.torque] = 1e-2 * read16(&frame.data[6]) * arena[at.gear_ratio]
    return TAKEN


cdef int drive_encode(double *arena, const GaitDrive *at, const GaitDrive *sizes, Frame *frames) noexcept nogil:
    cdef double torque = arena[at.torque_command]
    if not isfinite(torque):
        return -NOT_FINITE
    if not -arena[at.limit] <= torque <= arena[at.limit]:
        return -OUT_OF_LIMITS
    memset(frames, 0, sizeof(Frame))
    frames[0].id, frames[0].length, frames[0].data[0] = COMMAND + <uint32_t>arena[at.can_id], 4, TORQUE
    write16(&frames[0].data[2], 100.0 * arena[AUTHORITY] * torque / arena[at.gear_ratio])
    arena[at.torque_sent] = 1e-2 * read16(&frames[0].data[2]) * arena[at.gear_ratio]
    return 1


cdef struct Emulated:
    int32_t position, velocity, fault, torque, can_id, gear_ratio, state

EMULATED = items((<Emulated *>ITEMS)[0], "state[5]")


cdef int emulator_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.state
    if state[OWN_ID] == 0.0:
        state[OWN_ID] = arena[at.can_id]
    if frame.id != COMMAND + <uint32_t>state[OWN_ID]:
        return FOREIGN
    if frame.length != 4:
        return MALFORMED
    state[OWED] += 1.0
    if frame.data[0] == ENABLE:
        state[ENABLED] = 1.0
    elif frame.data[0] == DISABLE:
        state[ENABLED] = state[COMMANDED] = 0.0
    elif frame.data[0] == TORQUE:
        state[COMMANDED] = 1e-2 * read16(&frame.data[2])
    elif frame.data[0] == ZERO:
        state[ZERO_AT] = arena[at.position] * arena[at.gear_ratio]
    elif frame.data[0] == SET_ID:
        state[OWN_ID] = read16(&frame.data[2])
    return TAKEN


cdef inline double given(double *arena, const Emulated *at) noexcept nogil:
    """N·m of the motor."""
    cdef double *state = arena + at.state
    return state[COMMANDED] if state[ENABLED] != 0.0 and arena[at.fault] == 0.0 else 0.0


cdef int emulator_kernel(double *arena, const Emulated *at, const Emulated *sizes) noexcept nogil:
    arena[at.torque] = given(arena, at) * arena[at.gear_ratio]
    return OK


cdef int emulator_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + at.state
    cdef double gear = arena[at.gear_ratio]
    if state[OWED] == 0.0:
        return 0
    state[OWED] = 0.0
    memset(frames, 0, sizeof(Frame))
    frames[0].id, frames[0].length = REPLY + <uint32_t>state[OWN_ID], 8
    frames[0].data[0] = <uint8_t>(0x80 | <int>arena[at.fault] << 1 | <int>state[ENABLED])
    frames[0].data[1] = 65
    write16(&frames[0].data[2], 1e3 * (arena[at.position] * gear - state[ZERO_AT]))
    write16(&frames[0].data[4], 1e2 * arena[at.velocity] * gear)
    write16(&frames[0].data[6], 1e2 * given(arena, at))
    return 1


decode = export_decode(<decode_t>drive_decode, GAIT_DRIVE)
encode = export_encode(<encode_t>drive_encode, GAIT_DRIVE)
drive = export(<kernel_t>emulator_kernel, EMULATED)
emulated_decode = export_decode(<decode_t>emulator_decode, EMULATED)
emulated_encode = export_encode(<encode_t>emulator_encode, EMULATED)
