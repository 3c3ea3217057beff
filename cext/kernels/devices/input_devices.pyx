# cython: freethreading_compatible=True
"""Game controllers and keyboards: Linux's struct input_event of <linux/input.h>, 24 bytes each.

    0   s
    8   µs
    16  kind: 0 the stream itself, 1 a key or button, 3 an axis
    18  code
    20  value; of a key 1 down, 0 up, 2 held
"""

from libc.math cimport fabs, isfinite, rint
from libc.stdint cimport int32_t, uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOTED, NOT_FINITE, TAKEN, Frame, Rest, decode_t, each, encode_t, export_decode,
    export_encode, items,
)
from cext.conversion cimport to_i32
from cext.lines.stream_frames cimport BACK, BYTES, LOST

cdef enum: # numbers of each axis or button, in `plan`
    KIND, CODE, LOW, HIGH, WORDS

cdef enum:
    EVENT = 24
    STREAM = 0
    KEY = 1
    AXIS = 3
    DROPPED = 3                 # code of a STREAM event: events were lost


cdef inline uint32_t u16(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8


cdef inline double share(double value, double low, double high, double dead) noexcept nogil:
    """Return the position of an axis, -1 to 1, 0 around its centre."""
    cdef double x = 2.0 * (value - low) / (high - low) - 1.0
    x = 1.0 if x > 1.0 else -1.0 if x < -1.0 else x
    return 0.0 if fabs(x) <= dead else (x - dead if x > 0.0 else x + dead) / (1.0 - dead)


cdef struct Controls:
    int32_t age, connected, missed, dead_zone, plan
    Rest outputs                # axes and buttons, in the order of `plan`

CONTROLS = items((<Controls *>ITEMS)[0], "plan[...]")


cdef void release_all(double *arena, const Controls *at, const Controls *sizes) noexcept nogil:
    """Release all keys and buttons, since the state of the device is unknown."""
    cdef int index
    for index in range(sizes.plan // WORDS):
        arena[each(at, at.outputs)[index]] = 0.0


cdef int decode_kernel(double *arena, const Controls *at, const Controls *sizes, const Frame *frame) noexcept nogil:
    cdef const int32_t *outputs = each(at, at.outputs)
    cdef int count = sizes.plan // WORDS
    cdef const double *plan = arena + at.plan
    cdef double dead = arena[at.dead_zone]
    cdef const uint8_t *data
    cdef uint32_t kind, code
    cdef int32_t value
    cdef int offset = 0
    cdef int index
    if frame.id == LOST or frame.id == BACK:
        release_all(arena, at, sizes)
        arena[at.connected] = frame.id == BACK
        return NOTED
    if frame.id != BYTES or frame.length % EVENT != 0:
        return MALFORMED
    while offset < frame.length:
        data = &frame.data[offset]
        offset += EVENT
        kind, code = u16(data + 16), u16(data + 18)
        memcpy(&value, data + 20, 4)
        if kind == STREAM and code == DROPPED:
            arena[at.missed] += 1.0
            release_all(arena, at, sizes)
        for index in range(count):
            if kind == <uint32_t>plan[WORDS * index + KIND] and code == <uint32_t>plan[WORDS * index + CODE]:
                arena[outputs[index]] = (
                    share(value, plan[WORDS * index + LOW], plan[WORDS * index + HIGH],
                        dead) if kind == AXIS else value != 0)
    arena[at.connected] = 1.0
    return TAKEN


cdef int emulated_decode_kernel(double *arena, const int32_t *slots, const int32_t *sizes,
        const Frame *frame) noexcept nogil:
    return FOREIGN


cdef struct Emulated:
    int32_t plan, last
    Rest inputs                 # axes and buttons, in the order of `plan`

EMULATED = items((<Emulated *>ITEMS)[0], "plan[...] last[...]")


cdef int emulated_encode_kernel(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    """Send an event for each change, at most four per tick."""
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef const double *plan = arena + at.plan
    cdef double *last = arena + at.last
    cdef int count = 0
    cdef int index
    cdef int32_t value
    cdef uint16_t kind, code
    for index in range(sizes.plan // WORDS):
        if not isfinite(arena[inputs[index]]):
            return -NOT_FINITE
        kind, code = <uint16_t>plan[WORDS * index + KIND], <uint16_t>plan[WORDS * index + CODE]
        value = <int32_t>(arena[inputs[index]] != 0.0)
        if kind == AXIS:
            value = to_i32(rint(plan[WORDS * index + LOW]
                                  + 0.5 * (1.0 + arena[inputs[index]]) * (plan[WORDS * index + HIGH]
                                      - plan[WORDS * index + LOW])))
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


decode = export_decode(<decode_t>decode_kernel, CONTROLS)
emulated_decode = export_decode(emulated_decode_kernel, ())
emulated_encode = export_encode(<encode_t>emulated_encode_kernel, EMULATED)
