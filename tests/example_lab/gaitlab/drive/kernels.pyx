# cython: freethreading_compatible=True
"""The bytes of the laboratory's drive, for its block and for its emulator: gaitlab/drive/protocol.py."""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    AUTHORITY, FOREIGN, MALFORMED, NOT_FINITE, OK, OUT_OF_LIMITS, TAKEN, Frame, export, export_decode, export_encode,
)

cdef enum:
    COMMAND = 0x500
    REPLY = 0x580
    ENABLE = 1
    DISABLE = 2
    TORQUE = 3
    ZERO = 4
    SET_ID = 5

cdef enum: # items of GaitDrive
    TORQUE_COMMAND
    D_POSITION, D_VELOCITY, D_TORQUE, D_TEMPERATURE, D_FAULT, D_AGE, D_SENT
    D_ID, D_LIMIT, D_GEAR

cdef enum: # items of EmulatedGaitDrive
    E_POSITION, E_VELOCITY, E_FAULT
    E_TORQUE
    E_ID, E_GEAR
    E_STATE

cdef enum: # in E_STATE
    OWN_ID, ENABLED, COMMANDED, ZERO_AT, OWED


cdef inline int16_t read16(const uint8_t *data) noexcept nogil:
    return <int16_t>(data[0] | data[1] << 8)


cdef inline void write16(uint8_t *data, double x) noexcept nogil:
    cdef int16_t code = 32767 if x > 32767.0 else -32767 if x < -32767.0 else <int16_t>(x + (0.5 if x > 0.0 else -0.5))
    data[0], data[1] = <uint8_t>code, <uint8_t>(code >> 8)


cdef int drive_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    if frame.id != REPLY + <uint32_t>arena[slots[D_ID]]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    arena[slots[D_FAULT]] = frame.data[0] >> 1 & 63
    arena[slots[D_TEMPERATURE]] = frame.data[1] - 40.0
    arena[slots[D_POSITION]] = 1e-3 * read16(&frame.data[2]) / arena[slots[D_GEAR]]
    arena[slots[D_VELOCITY]] = 1e-2 * read16(&frame.data[4]) / arena[slots[D_GEAR]]
    arena[slots[D_TORQUE]] = 1e-2 * read16(&frame.data[6]) * arena[slots[D_GEAR]]
    return TAKEN


cdef int drive_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double torque = arena[slots[TORQUE_COMMAND]]
    if not isfinite(torque):
        return -NOT_FINITE
    if not -arena[slots[D_LIMIT]] <= torque <= arena[slots[D_LIMIT]]:
        return -OUT_OF_LIMITS
    memset(frames, 0, sizeof(Frame))
    frames[0].id, frames[0].length, frames[0].data[0] = COMMAND + <uint32_t>arena[slots[D_ID]], 4, TORQUE
    write16(&frames[0].data[2], 100.0 * arena[AUTHORITY] * torque / arena[slots[D_GEAR]])
    arena[slots[D_SENT]] = 1e-2 * read16(&frames[0].data[2]) * arena[slots[D_GEAR]]
    return 1


cdef int emulator_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + slots[E_STATE]
    if state[OWN_ID] == 0.0:
        state[OWN_ID] = arena[slots[E_ID]]
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
        state[ZERO_AT] = arena[slots[E_POSITION]] * arena[slots[E_GEAR]]
    elif frame.data[0] == SET_ID:
        state[OWN_ID] = read16(&frame.data[2])
    return TAKEN


cdef inline double given(double *arena, const int32_t *slots) noexcept nogil:
    """N·m of the motor."""
    cdef double *state = arena + slots[E_STATE]
    return state[COMMANDED] if state[ENABLED] != 0.0 and arena[slots[E_FAULT]] == 0.0 else 0.0


cdef int emulator_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    arena[slots[E_TORQUE]] = given(arena, slots) * arena[slots[E_GEAR]]
    return OK


cdef int emulator_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + slots[E_STATE]
    cdef double gear = arena[slots[E_GEAR]]
    if state[OWED] == 0.0:
        return 0
    state[OWED] = 0.0
    memset(frames, 0, sizeof(Frame))
    frames[0].id, frames[0].length = REPLY + <uint32_t>state[OWN_ID], 8
    frames[0].data[0] = <uint8_t>(0x80 | <int>arena[slots[E_FAULT]] << 1 | <int>state[ENABLED])
    frames[0].data[1] = 65
    write16(&frames[0].data[2], 1e3 * (arena[slots[E_POSITION]] * gear - state[ZERO_AT]))
    write16(&frames[0].data[4], 1e2 * arena[slots[E_VELOCITY]] * gear)
    write16(&frames[0].data[6], 1e2 * given(arena, slots))
    return 1


decode = export_decode(drive_decode)
encode = export_encode(drive_encode)
drive = export(emulator_kernel)
emulated_decode = export_decode(emulator_decode)
emulated_encode = export_encode(emulator_encode)
