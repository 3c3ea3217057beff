# cython: freethreading_compatible=True
"""Emergency stops: what ends a run before another command is sent, and the heartbeat of a button that is somewhere else.

    heartbeat   two bytes: a counter, one more (modulo 256) in each frame; 5A released, anything else pressed

A heartbeat whose counter stands still is a sender that hangs, or an old frame again: it is not news of a button that is released.
"""

from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport ESTOP, FOREIGN, MALFORMED, OK, PRESSED as STOP_WANTED, TAKEN, TIME, Frame, export, export_decode, export_encode

cdef enum:
    RELEASED_BYTE = 0x5A

cdef enum: # of EStopHeartbeat, in the order of its declaration
    PRESSED, AGE, COUNT
    CAN_ID, TIMEOUT
    STATE                       # the newest counter + 1, or 0; whether it has been pressed since the arming

cdef enum: # of EmulatedEStop
    E_PRESSED, E_SILENT
    E_CAN_ID, E_PERIOD
    E_STATE                     # the next counter; s, when the next heartbeat is due


cdef int stop_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # pressed
    cdef int i
    for i in range(sizes[0]):
        if not arena[slots[0] + i] == 0.0:                  # NaN is pressed
            return ESTOP
    return OK


cdef int rearm_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # request: the executor looks at it itself, while it waits
    return OK


cdef int heartbeat_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + slots[STATE]
    cdef bint pressed
    if frame.id != <uint32_t>arena[slots[CAN_ID]]:
        return FOREIGN
    if frame.length != 2:
        return MALFORMED
    pressed = frame.data[1] != RELEASED_BYTE
    if pressed:
        state[1] = 1.0
    elif state[0] == frame.data[0] + 1.0:
        return MALFORMED
    arena[slots[PRESSED]] = pressed
    arena[slots[COUNT]] += 1.0
    state[0] = frame.data[0] + 1.0
    return STOP_WANTED if pressed else TAKEN


cdef int heartbeat_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    # Sends nothing. Devices encode before any frame of a tick goes out, and one that refuses keeps back all of them.
    return -ESTOP if arena[slots[STATE] + 1] != 0.0 or not arena[slots[PRESSED]] == 0.0 else 0


cdef int emulated_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    return FOREIGN


cdef int emulated_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + slots[E_STATE]
    if not arena[slots[E_SILENT]] == 0.0 or arena[TIME] < state[1] - 1e-9:
        return 0
    state[1] = arena[TIME] + arena[slots[E_PERIOD]]
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>arena[slots[E_CAN_ID]]
    frames[0].length = 2
    frames[0].data[0] = <uint8_t>state[0]
    frames[0].data[1] = RELEASED_BYTE if arena[slots[E_PRESSED]] == 0.0 else 0
    state[0] = (state[0] + 1.0) if state[0] < 255.0 else 0.0
    return 1


emergency_stop = export(stop_kernel)
rearm = export(rearm_kernel)
estop_decode, estop_encode = export_decode(heartbeat_decode), export_encode(heartbeat_encode)
button_decode, button_encode = export_decode(emulated_decode), export_encode(emulated_encode)
