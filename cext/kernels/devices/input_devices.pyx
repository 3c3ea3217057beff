# cython: freethreading_compatible=True
"""Game controllers and keyboards: Linux's struct input_event of <linux/input.h>, 24 bytes each.

    0   s      8   µs     16   kind, 0 of the stream itself, 1 a key or button, 3 an axis    18   code    20   value, of a key 1 down, 0 up, 2 held
"""

from libc.math cimport fabs, isfinite, rint
from libc.stdint cimport int32_t, uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport FOREIGN, INPUTS, MALFORMED, NOT_FINITE, NOTED, OUTPUTS, PARAMETERS, TAKEN, Frame, export_decode, export_encode
from cext.lines.stream_frames cimport BACK, BYTES, LOST

cdef enum: # outputs behind those of axes and buttons
    AGE, CONNECTED, MISSED, OTHERS

cdef enum: # of each axis or button in the plan, its first memory
    KIND, CODE, LOW, HIGH, WORDS

cdef enum:
    EVENT = 24
    STREAM = 0
    KEY = 1
    AXIS = 3
    DROPPED = 3                 # code of a STREAM event: some were lost


cdef inline double *memory(double *arena, const int32_t *slots) noexcept nogil:
    return arena + slots[slots[INPUTS] + slots[OUTPUTS] + slots[PARAMETERS]]


cdef inline double *told(double *arena, const int32_t *slots, int index) noexcept nogil:
    return arena + slots[slots[INPUTS] + index]


cdef inline uint32_t u16(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8


cdef inline double share(double value, double low, double high, double dead) noexcept nogil:
    """Of an axis, -1 to 1 and 0 about its middle."""
    cdef double x = 2.0 * (value - low) / (high - low) - 1.0
    x = 1.0 if x > 1.0 else -1.0 if x < -1.0 else x
    return 0.0 if fabs(x) <= dead else (x - dead if x > 0.0 else x + dead) / (1.0 - dead)


cdef void let_go(double *arena, const int32_t *slots) noexcept nogil:
    """Whoever held it cannot be asked: nothing is held."""
    cdef int index
    for index in range(slots[OUTPUTS] - OTHERS):
        told(arena, slots, index)[0] = 0.0


cdef int decode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int count = slots[OUTPUTS] - OTHERS
    cdef const double *plan = memory(arena, slots)
    cdef double dead = (arena + slots[slots[INPUTS] + slots[OUTPUTS]])[0]
    cdef const uint8_t *data
    cdef uint32_t kind, code
    cdef int32_t value
    cdef int at = 0
    cdef int index
    if frame.id == LOST or frame.id == BACK:
        let_go(arena, slots)
        told(arena, slots, count + CONNECTED)[0] = frame.id == BACK
        return NOTED
    if frame.id != BYTES or frame.length % EVENT != 0:
        return MALFORMED
    while at < frame.length:
        data = &frame.data[at]
        at += EVENT
        kind, code = u16(data + 16), u16(data + 18)
        memcpy(&value, data + 20, 4)
        if kind == STREAM and code == DROPPED:
            told(arena, slots, count + MISSED)[0] += 1.0
            let_go(arena, slots)
        for index in range(count):
            if kind == <uint32_t>plan[WORDS * index + KIND] and code == <uint32_t>plan[WORDS * index + CODE]:
                told(arena, slots, index)[0] = (
                    share(value, plan[WORDS * index + LOW], plan[WORDS * index + HIGH], dead) if kind == AXIS else value != 0)
    told(arena, slots, count + CONNECTED)[0] = 1.0
    return TAKEN


cdef int emulated_decode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    return FOREIGN


cdef int emulated_encode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """An event for what has changed, at most four a tick."""
    cdef const double *plan = memory(arena, slots)
    cdef double *last = arena + slots[slots[INPUTS] + slots[OUTPUTS] + slots[PARAMETERS] + 1]
    cdef int count = 0
    cdef int index
    cdef int32_t value
    cdef uint16_t kind, code
    for index in range(slots[INPUTS]):
        if not isfinite(arena[slots[index]]):
            return -NOT_FINITE
        kind, code = <uint16_t>plan[WORDS * index + KIND], <uint16_t>plan[WORDS * index + CODE]
        value = <int32_t>(arena[slots[index]] != 0.0)
        if kind == AXIS:
            value = <int32_t>rint(plan[WORDS * index + LOW]
                                  + 0.5 * (1.0 + arena[slots[index]]) * (plan[WORDS * index + HIGH] - plan[WORDS * index + LOW]))
        if value == <int32_t>last[index] or count == 4:
            continue
        last[index] = value
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].length = EVENT
        memcpy(&frames[count].data[16], &kind, 2)
        memcpy(&frames[count].data[18], &code, 2)
        memcpy(&frames[count].data[20], &value, 4)
        count += 1
    return count


decode = export_decode(decode_kernel)
emulated_decode, emulated_encode = export_decode(emulated_decode_kernel), export_encode(emulated_encode_kernel)
