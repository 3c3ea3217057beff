# cython: freethreading_compatible=True
"""Inputs and outputs of the computer itself: edges as Linux tells them, struct gpio_v2_line_event of <linux/gpio.h>, 48 bytes each.

    0   ns, on the clock of the run    8   kind, 1 rising, 2 falling   12   line   16   number of the event, of all lines   20   of this line
"""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    ESTOP, FOREIGN, MALFORMED, NOTED, PRESSED as STOP_WANTED, TAKEN, TIME, Frame, export_decode, export_encode,
)
from cext.lines.stream_frames cimport BYTES, LEVEL, LOST

cdef enum:
    EVENT = 48
    RISING = 1
    FALLING = 2

cdef enum: # of every input, in the order of its declaration
    ON, KNOWN, RISES, FALLS, RISE_TIME, FALL_TIME, MISSED, AGE
    STATE                       # number of the newest event of this line + 1, or 0

cdef enum: # of EStopSwitch
    E_PRESSED, E_KNOWN, E_AGE
    E_STATE                     # whether it has been pressed

cdef enum: # of SyncOut
    S_PULSE, S_HIGH, S_DURATION
    S_STATE                     # s, when the pulse ends; whether there was one at the start; the level that was sent

cdef enum: # of EmulatedGpio
    G_LEVEL, G_LOST
    G_STATE                     # level that was told + 1, or 0; events so far; whether it is gone


cdef inline uint32_t u32(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8 | <uint32_t>data[2] << 16 | <uint32_t>data[3] << 24


cdef int edge(double *arena, const int32_t *slots, const uint8_t *data) noexcept nogil:
    """TAKEN, or MALFORMED for an event of no kind that there is."""
    cdef double *state = arena + slots[STATE]
    cdef uint32_t kind = u32(data + 8)
    cdef uint32_t number = u32(data + 20)
    cdef uint32_t wanted = <uint32_t><int64_t>state[0]              # the numbers begin anew behind the largest
    cdef int64_t when
    if kind != RISING and kind != FALLING:
        return MALFORMED
    memcpy(&when, data, sizeof(int64_t))
    if state[0] > 0.0 and number != wanted:                    # the kernel's own queue was full
        arena[slots[MISSED]] += <double>(<uint32_t>(number - wanted))
    state[0] = number + 1.0
    arena[slots[ON]] = kind == RISING
    arena[slots[KNOWN]] = 1.0
    if kind == RISING:
        arena[slots[RISES]] += 1.0
        arena[slots[RISE_TIME]] = 1e-9 * when
    else:
        arena[slots[FALLS]] += 1.0
        arena[slots[FALL_TIME]] = 1e-9 * when
    return TAKEN


cdef int input_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int answer = NOTED
    cdef int at = 0
    if frame.id == LEVEL:
        if frame.length != 1:
            return MALFORMED
        arena[slots[ON]] = frame.data[0] != 0
        arena[slots[KNOWN]] = 1.0
        return TAKEN
    if frame.id != BYTES:
        if frame.id == LOST:
            arena[slots[KNOWN]] = 0.0
        return NOTED
    if frame.length % EVENT != 0:
        return MALFORMED
    while at < frame.length:
        answer = edge(arena, slots, &frame.data[at])
        at += EVENT
    return answer


cdef int estop_decode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    """Active is released: a contact that opens, a broken wire and a line that is gone all press it."""
    cdef bint pressed = False
    cdef int at = 0
    if frame.id == LEVEL and frame.length == 1:
        pressed = frame.data[0] == 0
    elif frame.id == BYTES and frame.length % EVENT == 0 and frame.length > 0:
        while at < frame.length:                                # a press that has been let go within one read is one
            pressed = pressed or u32(&frame.data[at + 8]) != RISING
            at += EVENT
    else:
        pressed = True
    arena[slots[E_PRESSED]] = pressed
    arena[slots[E_KNOWN]] = 1.0
    if not pressed:
        return TAKEN
    arena[slots[E_STATE]] = 1.0
    return STOP_WANTED


cdef int estop_encode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    # Sends nothing. Devices encode before any frame of a tick goes out, and one that refuses keeps back all of them.
    return -ESTOP if arena[slots[E_STATE]] != 0.0 or arena[slots[E_PRESSED]] != 0.0 or arena[slots[E_KNOWN]] == 0.0 else 0


cdef int sync_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + slots[S_STATE]
    cdef bint high
    if state[1] == 0.0 or arena[slots[S_PULSE]] != 0.0:         # NaN is a pulse
        state[0] = arena[TIME] + arena[slots[S_DURATION]] - 1e-9
        state[1] = 1.0
    high = arena[TIME] < state[0]
    arena[slots[S_HIGH]] = high
    if state[2] == 1.0 + high:
        return 0
    state[2] = 1.0 + high
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].length = 1
    frames[0].data[0] = high
    return 1


cdef int gpio_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    return FOREIGN


cdef int gpio_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """Its level at first, then an event an edge."""
    cdef double *state = arena + slots[G_STATE]
    cdef bint level = not arena[slots[G_LEVEL]] == 0.0
    cdef bint lost = not arena[slots[G_LOST]] == 0.0
    cdef int64_t when = <int64_t>(1e9 * arena[TIME] + 0.5)
    cdef uint32_t kind = RISING if level else FALLING
    cdef uint32_t number
    memset(&frames[0], 0, sizeof(Frame))
    if lost:
        if state[2] != 0.0:
            return 0
        state[2] = 1.0
        frames[0].id = LOST
        return 1
    if state[2] != 0.0 or state[0] == 1.0 + level:
        return 0
    if state[0] == 0.0:
        frames[0].id, frames[0].length = LEVEL, 1
        frames[0].data[0] = level
    else:
        state[1] += 1.0
        number = <uint32_t>state[1]
        frames[0].length = EVENT
        memcpy(&frames[0].data[0], &when, 8)
        memcpy(&frames[0].data[8], &kind, 4)
        memcpy(&frames[0].data[16], &number, 4)
        memcpy(&frames[0].data[20], &number, 4)
    state[0] = 1.0 + level
    return 1


decode = export_decode(input_decode)
estop_decode, estop_encode = export_decode(estop_decode_kernel), export_encode(estop_encode_kernel)
pulse = export_encode(sync_encode)
emulated_decode, emulated_encode = export_decode(gpio_decode), export_encode(gpio_encode)
