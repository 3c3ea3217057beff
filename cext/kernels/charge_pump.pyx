# cython: freethreading_compatible=True
"""Charge pump: a level that changes with every call of `encode`, and a relay, emulated, that holds only while it changes.

On a GPIO line a frame is the level, one byte. To a microcontroller it is a message: a counter (one byte) and its CRC-16/CCITT-FALSE, least
significant byte first, stuffed by COBS, so that zero ends it and is nowhere else: five bytes.
"""

from libc.stdint cimport int32_t, int64_t, uint8_t
from libc.string cimport memset

from cext.abi cimport FOREIGN, MALFORMED, NOTED, OK, TIME, Frame, export, export_decode, export_encode
from cext.kernels.devices.cobs cimport checksum, stuff, unstuff
from cext.lines.stream_frames cimport BACK, BYTES, LOST

cdef enum: # of ChargePump, in the order of its declaration
    CHANGES                     # also counts those of arming: memory is reset at tick 0, outputs are not
    FAULT
    MESSAGES

cdef enum: # of EmulatedChargePump
    R_LOST, R_HOLDS, R_CHANGES, R_HOLD, R_MESSAGES
    R_STATE                     # as the enum below
    R_BUFFER

cdef enum: # in R_STATE
    NEWEST                      # level or number + 1, 0 before the first
    CHANGED                     # s
    REPORTED
    FILLED

cdef enum:
    PLAIN = 3                   # bytes of a message before it is stuffed
    STUFFED = PLAIN + 1         # and after, without the zero at the end
    ROOM = 16                   # bytes of R_BUFFER


cdef int pump_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    if frame.id == LOST:
        arena[slots[FAULT]] = 1.0
    elif frame.id == BACK:
        arena[slots[FAULT]] = 0.0
    return NOTED


cdef int pump_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef uint8_t[PLAIN] plain
    cdef int number = (<int64_t>arena[slots[CHANGES]] + 1) & 0xFF
    cdef int crc
    arena[slots[CHANGES]] += 1.0
    memset(&frames[0], 0, sizeof(Frame))
    if arena[slots[MESSAGES]] == 0.0:
        frames[0].length = 1
        frames[0].data[0] = <uint8_t>(number & 1)
        return 1
    plain[0] = <uint8_t>number
    crc = checksum(plain, 1)
    plain[1], plain[2] = <uint8_t>crc, <uint8_t>(crc >> 8)
    frames[0].length = <uint8_t>stuff(plain, PLAIN, frames[0].data)
    return 1


cdef void take(double *arena, const int32_t *slots, double value) noexcept nogil:
    cdef double *state = arena + slots[R_STATE]
    if state[NEWEST] != value + 1.0:
        if state[NEWEST] != 0.0:                                # the first level is none that has changed
            arena[slots[R_CHANGES]] += 1.0
            state[CHANGED] = arena[TIME]
        state[NEWEST] = value + 1.0


cdef int relay_decode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + slots[R_STATE]
    cdef uint8_t *buffer = <uint8_t *>(arena + slots[R_BUFFER])
    cdef int answer = NOTED
    cdef int i, filled
    if frame.id != BYTES:
        return FOREIGN
    if arena[slots[R_MESSAGES]] == 0.0:
        if frame.length != 1:
            return MALFORMED
        take(arena, slots, frame.data[0] != 0)
        return NOTED
    for i in range(frame.length):
        filled = <int>state[FILLED]
        if frame.data[i] != 0:
            buffer[min(filled, ROOM - 1)] = frame.data[i]
            state[FILLED] = min(filled + 1, ROOM)
            continue
        state[FILLED] = 0.0
        if filled == STUFFED and unstuff(buffer, filled) == PLAIN and checksum(buffer, 1) == (buffer[1] | buffer[2] << 8):
            take(arena, slots, buffer[0])
        else:
            answer = MALFORMED
    return answer


cdef int relay_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    arena[slots[R_HOLDS]] = arena[slots[R_CHANGES]] > 0.0 and arena[TIME] - arena[slots[R_STATE] + CHANGED] < arena[slots[R_HOLD]] - 1e-9
    return OK


cdef int relay_encode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """The loss of its line, and its return."""
    cdef double *state = arena + slots[R_STATE]
    cdef bint lost = not arena[slots[R_LOST]] == 0.0
    if lost == (state[REPORTED] != 0.0):
        return 0
    state[REPORTED] = lost
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = LOST if lost else BACK
    return 1


decode, encode = export_decode(pump_decode), export_encode(pump_encode)
relay, relay_decode, relay_encode = export(relay_kernel), export_decode(relay_decode_kernel), export_encode(relay_encode_kernel)
