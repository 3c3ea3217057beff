# cython: freethreading_compatible=True
"""Charge pump: a level that changes with every call of `encode`, and an emulated relay that holds while it changes.

On a GPIO line, a frame is the level, one byte. To a microcontroller, it is a message of five bytes: a counter (one
byte) and its CRC-16/CCITT-FALSE, least significant byte first, COBS-encoded with a zero at the end.
"""

from libc.stdint cimport int32_t, int64_t, uint8_t
from libc.string cimport memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOTED, OK, TIME, Frame, decode_t, encode_t, export, export_decode, export_encode,
    items, kernel_t,
)
from cext.kernels.devices.cobs cimport checksum, stuff, unstuff
from cext.lines.stream_frames cimport BACK, BYTES, LOST

cdef enum: # in `state` of a Relay
    NEWEST                      # level or number + 1, 0 before the first
    CHANGED                     # s
    REPORTED
    FILLED

cdef enum:
    PLAIN = 3                   # bytes of a message before COBS encoding
    STUFFED = PLAIN + 1         # bytes after COBS encoding, without the zero at the end
    ROOM = 16                   # bytes of `buffer`


cdef struct Pump:
    int32_t changes             # includes those of arming: memory is reset at tick 0, outputs are not
    int32_t fault, messages

PUMP = items((<Pump *>ITEMS)[0])


cdef int pump_decode(double *arena, const Pump *at, const Pump *sizes, const Frame *frame) noexcept nogil:
    if frame.id == LOST:
        arena[at.fault] = 1.0
    elif frame.id == BACK:
        arena[at.fault] = 0.0
    return NOTED


cdef int pump_encode(double *arena, const Pump *at, const Pump *sizes, Frame *frames) noexcept nogil:
    cdef uint8_t[PLAIN] plain
    cdef int number = (<int64_t>arena[at.changes] + 1) & 0xFF
    cdef int crc
    arena[at.changes] += 1.0
    memset(&frames[0], 0, sizeof(Frame))
    if arena[at.messages] == 0.0:
        frames[0].length = 1
        frames[0].data[0] = <uint8_t>(number & 1)
        return 1
    plain[0] = <uint8_t>number
    crc = checksum(plain, 1)
    plain[1], plain[2] = <uint8_t>crc, <uint8_t>(crc >> 8)
    frames[0].length = <uint8_t>stuff(plain, PLAIN, frames[0].data)
    return 1


cdef struct Relay:
    int32_t lost, holds, changes, hold, messages
    int32_t state               # the enum above
    int32_t buffer              # bytes of an incomplete message

RELAY = items((<Relay *>ITEMS)[0], "state[4] buffer[2]")


cdef void take(double *arena, const Relay *at, double value) noexcept nogil:
    cdef double *state = arena + at.state
    if state[NEWEST] != value + 1.0:
        if state[NEWEST] != 0.0:                                # the first level is not a change
            arena[at.changes] += 1.0
            state[CHANGED] = arena[TIME]
        state[NEWEST] = value + 1.0


cdef int relay_decode_kernel(double *arena, const Relay *at, const Relay *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.state
    cdef uint8_t *buffer = <uint8_t *>(arena + at.buffer)
    cdef int answer = NOTED
    cdef int i, filled
    if frame.id != BYTES:
        return FOREIGN
    if arena[at.messages] == 0.0:
        if frame.length != 1:
            return MALFORMED
        take(arena, at, frame.data[0] != 0)
        return NOTED
    for i in range(frame.length):
        filled = <int>state[FILLED]
        if frame.data[i] != 0:
            buffer[min(filled, ROOM - 1)] = frame.data[i]
            state[FILLED] = min(filled + 1, ROOM)
            continue
        state[FILLED] = 0.0
        if filled == STUFFED and unstuff(buffer, filled) == PLAIN and checksum(buffer, 1) == (buffer[1]
                | buffer[2] << 8):
            take(arena, at, buffer[0])
        else:
            answer = MALFORMED
    return answer


cdef int relay_kernel(double *arena, const Relay *at, const Relay *sizes) noexcept nogil:
    arena[at.holds] = arena[at.changes] > 0.0 and arena[TIME] - arena[at.state + CHANGED] < arena[at.hold] - 1e-9
    return OK


cdef int relay_encode_kernel(double *arena, const Relay *at, const Relay *sizes, Frame *frames) noexcept nogil:
    """Handle the loss and the return of the line."""
    cdef double *state = arena + at.state
    cdef bint lost = not arena[at.lost] == 0.0
    if lost == (state[REPORTED] != 0.0):
        return 0
    state[REPORTED] = lost
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = LOST if lost else BACK
    return 1


decode, encode = export_decode(<decode_t>pump_decode, PUMP), export_encode(<encode_t>pump_encode, PUMP)
relay = export(<kernel_t>relay_kernel, RELAY)
relay_decode = export_decode(<decode_t>relay_decode_kernel, RELAY)
relay_encode = export_encode(<encode_t>relay_encode_kernel, RELAY)
