# cython: freethreading_compatible=True
"""GPIO lines of the computer: edges as Linux's struct gpio_v2_line_event of <linux/gpio.h>, 48 bytes each.

    0   ns, on the clock of the run
    8   kind, 1 rising, 2 falling
    12  line
    16  number of the event, counted over all lines
    20  number of the event, counted over this line
"""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    ESTOP, FOREIGN, ITEMS, MALFORMED, NOTED, PRESSED as STOP_WANTED, TAKEN, TIME, Frame, decode_t, encode_t,
    export_decode, export_encode, items,
)
from cext.lines.stream_frames cimport BYTES, LEVEL, LOST

cdef enum:
    EVENT = 48
    RISING = 1
    FALLING = 2


cdef inline uint32_t u32(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8 | <uint32_t>data[2] << 16 | <uint32_t>data[3] << 24


cdef struct Line:
    int32_t on, known, rises, falls, rise_time, fall_time, missed
    int32_t state               # number of this line's newest event + 1, or 0

LINE = items((<Line *>ITEMS)[0])


cdef int edge(double *arena, const Line *at, const uint8_t *data) noexcept nogil:
    """Return TAKEN, or MALFORMED for an event of an unknown kind."""
    cdef double *state = arena + at.state
    cdef uint32_t kind = u32(data + 8)
    cdef uint32_t number = u32(data + 20)
    cdef uint32_t expected = <uint32_t><int64_t>state[0]            # wraps after the largest number
    cdef int64_t when
    if kind != RISING and kind != FALLING:
        return MALFORMED
    memcpy(&when, data, sizeof(int64_t))
    if state[0] > 0.0 and number != expected:                  # the kernel's own queue was full
        arena[at.missed] += <double>(<uint32_t>(number - expected))
    state[0] = number + 1.0
    arena[at.on] = kind == RISING
    arena[at.known] = 1.0
    if kind == RISING:
        arena[at.rises] += 1.0
        arena[at.rise_time] = 1e-9 * when
    else:
        arena[at.falls] += 1.0
        arena[at.fall_time] = 1e-9 * when
    return TAKEN


cdef int input_decode(double *arena, const Line *at, const Line *sizes, const Frame *frame) noexcept nogil:
    cdef int answer = NOTED
    cdef int offset = 0
    if frame.id == LEVEL:
        if frame.length != 1:
            return MALFORMED
        arena[at.on] = frame.data[0] != 0
        arena[at.known] = 1.0
        return TAKEN
    if frame.id != BYTES:
        if frame.id == LOST:
            arena[at.known] = 0.0
        return NOTED
    if frame.length % EVENT != 0:
        return MALFORMED
    while offset < frame.length:
        answer = edge(arena, at, &frame.data[offset])
        offset += EVENT
    return answer


cdef struct Switch:
    int32_t pressed, known
    int32_t state               # whether it has been pressed

SWITCH = items((<Switch *>ITEMS)[0])


cdef int estop_decode_kernel(double *arena, const Switch *at, const Switch *sizes, const Frame *frame) noexcept nogil:
    """Decode an emergency stop. Active is released: an open contact, a broken wire and a lost line count as pressed."""
    cdef bint pressed = False
    cdef int offset = 0
    if frame.id == LEVEL and frame.length == 1:
        pressed = frame.data[0] == 0
    elif frame.id == BYTES and frame.length % EVENT == 0 and frame.length > 0:
        while offset < frame.length:                                # a press released within one read counts
            pressed = pressed or u32(&frame.data[offset + 8]) != RISING
            offset += EVENT
    else:
        pressed = True
    arena[at.pressed] = pressed
    arena[at.known] = 1.0
    if not pressed:
        return TAKEN
    arena[at.state] = 1.0
    return STOP_WANTED


cdef int estop_encode_kernel(double *arena, const Switch *at, const Switch *sizes, Frame *frames) noexcept nogil:
    # Sends nothing. All devices encode before any frame of a tick is sent; if one rejects its command, none is sent.
    return -ESTOP if arena[at.state] != 0.0 or arena[at.pressed] != 0.0 or arena[at.known] == 0.0 else 0


cdef struct Pulse:
    int32_t pulse, high, duration
    int32_t state               # end of the pulse, s; whether there was one at the start; level sent

PULSE = items((<Pulse *>ITEMS)[0], "state[3]")


cdef int sync_encode(double *arena, const Pulse *at, const Pulse *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + at.state
    cdef bint high
    if state[1] == 0.0 or arena[at.pulse] != 0.0:         # NaN counts as a pulse
        state[0] = arena[TIME] + arena[at.duration] - 1e-9
        state[1] = 1.0
    high = arena[TIME] < state[0]
    arena[at.high] = high
    if state[2] == 1.0 + high:
        return 0
    state[2] = 1.0 + high
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].length = 1
    frames[0].data[0] = high
    return 1


cdef struct Emulated:
    int32_t level, lost, on
    int32_t state               # level sent + 1, or 0; events so far; whether the line is lost

EMULATED = items((<Emulated *>ITEMS)[0], "state[3]")


cdef int gpio_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    if frame.id != BYTES or frame.length != 1:
        return FOREIGN
    arena[at.on] = frame.data[0] != 0
    return TAKEN


cdef int gpio_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    """Send the level first, then one event per edge."""
    cdef double *state = arena + at.state
    cdef bint level = not arena[at.level] == 0.0
    cdef bint lost = not arena[at.lost] == 0.0
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


decode = export_decode(<decode_t>input_decode, LINE)
estop_decode = export_decode(<decode_t>estop_decode_kernel, SWITCH)
estop_encode = export_encode(<encode_t>estop_encode_kernel, SWITCH)
pulse = export_encode(<encode_t>sync_encode, PULSE)
emulated_decode = export_decode(<decode_t>gpio_decode, EMULATED)
emulated_encode = export_encode(<encode_t>gpio_encode, EMULATED)
