# cython: freethreading_compatible=True
"""Emergency stops, which end a run before another command is sent, and the heartbeat of a remote button.

    heartbeat   two bytes: a counter, incremented (modulo 256) in each frame; 5A released, any other value pressed

Only a frame whose number is the next one counts, or a later one if frames can have been lost meanwhile. Repeated and
earlier numbers come from a sender that hangs, from a recorded stream, or from a second sender; if they persist beside
frames that count, the run ends: two senders would hide each other's death.
"""

from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    ESTOP, FIRST_OWN_STATUS, FOREIGN, ITEMS, MALFORMED, OK, PRESSED as STOP_WANTED, TAKEN, TIME, Frame, decode_t, encode_t, export,
    export_decode, export_encode, items, kernel_t,
)

cdef enum:
    RELEASED_BYTE = 0x5A
    PERIOD_MINIMUM = 1000000            # ns between two heartbeats: limits the number of lost ones in a gap
    # frames: disorder above which a heartbeat ends the run. A repeated number adds 2, one out of order 3; a heartbeat
    # takes half a frame away
    DISORDER_LIMIT = 24
    DISORDERED = FIRST_OWN_STATUS       # status: the numbers of the frames are not one rising sequence

cdef enum:                              # state of a heartbeat
    NEWEST = 0                          # number of the newest frame + 1, or 0
    WAS_PRESSED = 1                     # 1 if the button was pressed since arming
    TIME_OF_NEWEST = 2                  # ns
    DISORDER = 3                        # frames; below 0 once a frame that counts has followed too many others

cdef struct EmergencyStop:
    int32_t pressed

EMERGENCY_STOP = items((<EmergencyStop *>ITEMS)[0], "pressed[...]")


cdef int stop_kernel(double *arena, const EmergencyStop *at, const EmergencyStop *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.pressed):
        if not arena[at.pressed + i] == 0.0:                  # NaN counts as pressed
            return ESTOP
    return OK


cdef int rearm_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # the executor reads `request` itself while it waits
    return OK


cdef struct Heartbeat:
    int32_t pressed, count, can_id
    int32_t state

HEARTBEAT = items((<Heartbeat *>ITEMS)[0], "state[4]")


cdef int heartbeat_decode(double *arena, const Heartbeat *at, const Heartbeat *sizes,
        const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.state
    cdef bint pressed
    if frame.id != <uint32_t>arena[at.can_id]:
        return FOREIGN
    if frame.length != 2:
        return MALFORMED
    pressed = frame.data[1] != RELEASED_BYTE
    if pressed:                                               # whoever sends it
        state[WAS_PRESSED] = 1.0
    elif state[NEWEST] != 0.0 and not follows(state, frame):
        return MALFORMED
    arena[at.pressed] = pressed
    arena[at.count] += 1.0
    state[NEWEST] = frame.data[0] + 1.0
    state[TIME_OF_NEWEST] = <double>frame.time
    return STOP_WANTED if pressed else TAKEN


cdef bint follows(double *state, const Frame *frame) noexcept nogil:
    """Return whether a frame continues the rising sequence of numbers, and count the others."""
    cdef int step = (frame.data[0] - <int>state[NEWEST] + 1) & 0xFF
    cdef double lost = (frame.time - state[TIME_OF_NEWEST]) / PERIOD_MINIMUM      # at most
    cdef bint counts = 0 < step < 128 and step - 1 <= lost
    if state[DISORDER] < 0.0:
        return counts
    if not counts:
        state[DISORDER] += 2.0 if step == 0 else 3.0
    elif state[DISORDER] > DISORDER_LIMIT:
        state[DISORDER] = -1.0
    else:
        state[DISORDER] = max(state[DISORDER] - 0.5, 0.0)
    return counts


cdef int heartbeat_encode(double *arena, const Heartbeat *at, const Heartbeat *sizes, Frame *frames) noexcept nogil:
    # Sends nothing. All devices encode before any frame of a tick is sent; if one rejects its command, none is sent.
    if arena[at.state + WAS_PRESSED] != 0.0 or not arena[at.pressed] == 0.0:
        return -ESTOP
    return -DISORDERED if arena[at.state + DISORDER] < 0.0 else 0


cdef struct Button:
    int32_t pressed, silent, can_id, period
    int32_t state               # the next counter; time at which the next heartbeat is due, s

BUTTON = items((<Button *>ITEMS)[0], "state[2]")


cdef int emulated_decode(double *arena, const Button *at, const Button *sizes, const Frame *frame) noexcept nogil:
    return FOREIGN


cdef int emulated_encode(double *arena, const Button *at, const Button *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + at.state
    if not arena[at.silent] == 0.0 or arena[TIME] < state[1] - 1e-9:
        return 0
    state[1] = arena[TIME] + arena[at.period]
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>arena[at.can_id]
    frames[0].length = 2
    frames[0].data[0] = <uint8_t>state[0]
    frames[0].data[1] = RELEASED_BYTE if arena[at.pressed] == 0.0 else 0
    state[0] = (state[0] + 1.0) if state[0] < 255.0 else 0.0
    return 1


emergency_stop = export(<kernel_t>stop_kernel, EMERGENCY_STOP)
rearm = export(rearm_kernel, ())
estop_decode = export_decode(<decode_t>heartbeat_decode, HEARTBEAT)
estop_encode = export_encode(<encode_t>heartbeat_encode, HEARTBEAT)
button_decode = export_decode(<decode_t>emulated_decode, BUTTON)
button_encode = export_encode(<encode_t>emulated_encode, BUTTON)
