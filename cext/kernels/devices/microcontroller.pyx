# cython: freethreading_compatible=True
"""Packets of a microcontroller, out of bytes as they come: typed fields in COBS with a checksum, or lines of numbers.

    packet    counter (one byte), fields, checksum, least significant byte first; stuffed, so that zero ends it and is nowhere else
    line      counter, numbers, with commas between, a line feed at the end; what begins with # is a remark

The rest of a packet whose beginning was not heard, at the start or behind a gap, is no corrupt one. That of a line is not even read:
without its first digits a number is another, and no checksum tells.
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t, uint8_t, uint64_t
from libc.stdio cimport snprintf
from libc.string cimport memcpy, memset

from cext.abi cimport (
    FRAME_BYTES, INPUTS, MALFORMED, NOT_FINITE, NOTED, OUTPUTS, PARAMETERS, TAKEN, TIME, Frame, export_decode,
    export_encode,
)
from cext.kernels.devices.clock_map cimport DeviceClock, sampled
from cext.kernels.devices.cobs cimport checksum, stuff, unstuff
from cext.kernels.devices.fields_of_bytes cimport number, put_number, size_of
from cext.kernels.bernoulli cimport lucky
from cext.ring.newest_ring cimport GAP
from cext.lines.stream_frames cimport BYTES

cdef extern from *:
    """
    #ifndef _GNU_SOURCE
    #define _GNU_SOURCE
    #endif
    #include <locale.h>
    #include <stdlib.h>
    static locale_t tw_plain;
    static void tw_prepare(void) { tw_plain = newlocale(LC_ALL_MASK, "C", (locale_t)0); }
    static double tw_number(const char *text, char **end) { return strtod_l(text, end, tw_plain); }
    """
    void prepare "tw_prepare"() noexcept nogil
    double number_of "tw_number"(const char *text, char **end) noexcept nogil

cdef enum: # outputs behind those of the fields
    AGE, COUNT, LOST, CORRUPT, SAMPLE_TIME, CLOCK_DRIFT, COUNTERS

cdef enum: # memory
    PLAN                        # lines?, whether there is a counter, bytes of a packet's fields, then of each field: type, scale
    STATE                       # as the enum below
    BUFFER                      # bytes of the packet that is coming, as they are
    CLOCK_PLAN                  # which of the numbers is the device's clock, -1: none; s of a count; s after which it begins anew, 0: never
    CLOCK                       # a DeviceClock

cdef enum:
    LINES, COUNTED, SIZE, FIRST_FIELD

cdef enum: # in STATE
    FILLED                      # bytes in BUFFER
    WHOLE                       # whether it was heard from its beginning
    TOO_LONG
    NEXT                        # counter that is expected, -1: any

cdef enum: # the emulated one's inputs behind those of the fields
    SILENT, DROPPED, BROKEN, FAULTS

cdef enum: # its parameters and memory
    PERIOD = 0
    E_PLAN = 0
    E_STATE                     # as the enum below
    E_OUT                       # bytes that wait to be sent

cdef enum: # in E_STATE
    NUMBER                      # counter of the next packet
    DUE                         # s
    LUCK
    FROM                        # bytes that wait,
    UNTIL

cdef enum:
    MOST = 256                  # bytes of a packet as it goes over the line
    LINE = 1024                 # of a line


cdef inline double *item(double *arena, const int32_t *slots, int kind, int index) noexcept nogil:
    """Of a kind: 0 inputs, 1 outputs, 2 parameters, 3 memory."""
    cdef int place = index
    if kind > 0:
        place += slots[INPUTS]
    if kind > 1:
        place += slots[OUTPUTS]
    if kind > 2:
        place += slots[PARAMETERS]
    return arena + slots[place]


cdef void put(double *arena, const int32_t *slots, const int32_t *sizes, const double *plan, const double *values) noexcept nogil:
    """The values of a packet, scaled, to the outputs."""
    cdef int field, i
    cdef int at = 0
    cdef double *y
    for field in range(slots[OUTPUTS] - COUNTERS):
        y = item(arena, slots, 1, field)
        for i in range(sizes[slots[INPUTS] + field]):
            y[i] = values[at] * plan[FIRST_FIELD + 2 * field + 1]
            at += 1


cdef void count(double *arena, const int32_t *slots, double *state, double counter) noexcept nogil:
    """A packet, and those that the counter says are missing in front of it."""
    cdef int first = slots[OUTPUTS] - COUNTERS
    item(arena, slots, 1, first + COUNT)[0] += 1.0
    if counter < 0.0:
        return
    if state[NEXT] >= 0.0:
        item(arena, slots, 1, first + LOST)[0] += <double>((<int>counter - <int>state[NEXT]) & 0xFF)
    state[NEXT] = <double>((<int>counter + 1) & 0xFF)


cdef void note_time(double *arena, const int32_t *slots, const double *values, double came) noexcept nogil:
    """When the packet was taken: by its own clock, or else when it came. came : s"""
    cdef const double *plan = item(arena, slots, 3, CLOCK_PLAN)
    cdef DeviceClock *clock = <DeviceClock *>item(arena, slots, 3, CLOCK)
    cdef int first = slots[OUTPUTS] - COUNTERS
    if plan[0] >= 0.0:
        came = sampled(clock, values[<int>plan[0]] * plan[1], plan[2], came)
        item(arena, slots, 1, first + CLOCK_DRIFT)[0] = clock.map.slope
    item(arena, slots, 1, first + SAMPLE_TIME)[0] = came


cdef int packet(double *arena, const int32_t *slots, const int32_t *sizes, double *state, const double *plan, uint8_t *data,
                double came) noexcept nogil:
    """What stood in front of a zero. TAKEN, or MALFORMED"""
    cdef double[MOST] values
    cdef int size = <int>plan[SIZE]
    cdef int counted = <int>plan[COUNTED]
    cdef int length = unstuff(data, <int>state[FILLED])
    cdef int at = counted
    cdef int values_count = 0
    cdef int field, i, kind
    if length != counted + size + 2 or checksum(data, length - 2) != (data[length - 2] | data[length - 1] << 8):
        return MALFORMED
    for field in range(slots[OUTPUTS] - COUNTERS):
        kind = <int>plan[FIRST_FIELD + 2 * field]
        for i in range(sizes[slots[INPUTS] + field]):
            values[values_count] = number(data + at, kind)
            values_count += 1
            at += size_of(kind)
    put(arena, slots, sizes, plan, values)
    note_time(arena, slots, values, came)
    count(arena, slots, state, data[0] if counted else -1.0)
    return TAKEN


cdef int line(double *arena, const int32_t *slots, const int32_t *sizes, double *state, const double *plan, uint8_t *data,
              double came) noexcept nogil:
    """What stood in front of a line feed. TAKEN, NOTED for a remark, or MALFORMED"""
    cdef double[MOST] values
    cdef int length = <int>state[FILLED]
    cdef int wanted = <int>plan[COUNTED]
    cdef int counted = wanted
    cdef char *at = <char *>data
    cdef char *after = NULL
    cdef int field, i
    for field in range(slots[OUTPUTS] - COUNTERS):
        wanted += sizes[slots[INPUTS] + field]
    while length > 0 and (data[length - 1] == 13 or data[length - 1] == 32 or data[length - 1] == 9):
        length -= 1
    data[length] = 0
    if length == 0 or data[0] == 35:
        return NOTED
    for i in range(wanted):
        values[i] = number_of(at, &after)
        if after == at:
            return MALFORMED
        at = after
        while at[0] == 32 or at[0] == 9:
            at += 1
        if at[0] != (44 if i < wanted - 1 else 0):
            return MALFORMED
        at += 1
    if at - 1 != <char *>data + length:             # a zero within
        return MALFORMED
    if counted and not 0.0 <= values[0] < 4294967296.0:
        return MALFORMED
    put(arena, slots, sizes, plan, values + counted)
    note_time(arena, slots, values + counted, came)
    count(arena, slots, state, <double>(<uint64_t>values[0] & 0xFF) if counted else -1.0)
    return TAKEN


cdef int decode_kernel(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef const double *plan = item(arena, slots, 3, PLAN)
    cdef double *state = item(arena, slots, 3, STATE)
    cdef uint8_t *data = <uint8_t *>item(arena, slots, 3, BUFFER)
    cdef bint lines = plan[LINES] != 0.0
    cdef uint8_t end = 10 if lines else 0
    cdef int room = (LINE if lines else MOST) - 1
    cdef bint taken = False
    cdef bint corrupt = False
    cdef int i, answer
    if frame.id != BYTES or frame.flags & GAP:      # gone, back, or something was missed: what there is of a packet stays a part
        state[FILLED] = state[WHOLE] = state[TOO_LONG] = 0.0
    if frame.id != BYTES:
        return NOTED
    for i in range(frame.length):
        if frame.data[i] != end:
            if state[FILLED] < room:
                data[<int>state[FILLED]] = frame.data[i]
                state[FILLED] += 1.0
            else:
                state[TOO_LONG] = 1.0
            continue
        answer = NOTED
        if state[TOO_LONG] != 0.0:
            answer = MALFORMED
        elif state[FILLED] > 0.0 and (state[WHOLE] != 0.0 or not lines):
            answer = (line if lines else packet)(arena, slots, sizes, state, plan, data, frame.time * 1e-9)
        if answer == TAKEN:
            taken = True
        elif answer == MALFORMED and state[WHOLE] != 0.0:
            corrupt = True
            item(arena, slots, 1, slots[OUTPUTS] - COUNTERS + CORRUPT)[0] += 1.0
        state[FILLED] = state[TOO_LONG] = 0.0
        state[WHOLE] = 1.0
    return TAKEN if taken else MALFORMED if corrupt else NOTED


cdef int make_packet(double *arena, const int32_t *slots, const int32_t *sizes, const double *plan, double counter, uint8_t *out) noexcept nogil:
    cdef uint8_t[MOST] plain
    cdef int at = 0
    cdef int field, i, kind
    cdef int crc
    if plan[COUNTED] != 0.0:
        plain[0] = <uint8_t>counter
        at = 1
    for field in range(slots[INPUTS] - FAULTS):
        kind = <int>plan[FIRST_FIELD + 2 * field]
        for i in range(sizes[field]):
            put_number(plain + at, kind, arena[slots[field] + i] / plan[FIRST_FIELD + 2 * field + 1])
            at += size_of(kind)
    crc = checksum(plain, at)
    plain[at], plain[at + 1] = <uint8_t>crc, <uint8_t>(crc >> 8)
    return stuff(plain, at + 2, out)


cdef int make_line(double *arena, const int32_t *slots, const int32_t *sizes, const double *plan, double counter, uint8_t *out) noexcept nogil:
    cdef char *text = <char *>out
    cdef int at = 0
    cdef int field, i
    if plan[COUNTED] != 0.0:
        at = snprintf(text, LINE, "%d,", <int>counter)
    for field in range(slots[INPUTS] - FAULTS):
        for i in range(sizes[field]):
            at += snprintf(text + at, LINE - at, "%.9g,", arena[slots[field] + i] / plan[FIRST_FIELD + 2 * field + 1])
    text[at - 1] = 10
    return at


cdef int send_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef const double *plan = item(arena, slots, 3, E_PLAN)
    cdef double *state = item(arena, slots, 3, E_STATE)
    cdef uint8_t *out = <uint8_t *>item(arena, slots, 3, E_OUT)
    cdef int faults = slots[INPUTS] - FAULTS
    cdef int count = 0
    cdef int field, i
    for field in range(faults):
        for i in range(sizes[field]):
            if not isfinite(arena[slots[field] + i]):
                return -NOT_FINITE
    if state[FROM] >= state[UNTIL] and arena[TIME] >= state[DUE] - 1e-9:
        state[DUE] += item(arena, slots, 2, PERIOD)[0]
        if state[DUE] < arena[TIME]:
            state[DUE] = arena[TIME] + item(arena, slots, 2, PERIOD)[0]
        state[FROM] = 0.0
        state[UNTIL] = (make_line if plan[LINES] != 0.0 else make_packet)(arena, slots, sizes, plan, state[NUMBER], out)
        state[NUMBER] = <double>((<int>state[NUMBER] + 1) & 0xFF)
        if arena[slots[faults + SILENT]] != 0.0 or lucky(&state[LUCK], arena[slots[faults + DROPPED]]):
            state[UNTIL] = 0.0
        elif lucky(&state[LUCK], arena[slots[faults + BROKEN]]):
            out[<int>state[UNTIL] // 2] ^= 0x15
    while state[FROM] < state[UNTIL] and count < 4:
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].length = <uint8_t>min(FRAME_BYTES, <int>(state[UNTIL] - state[FROM]))
        memcpy(frames[count].data, out + <int>state[FROM], frames[count].length)
        state[FROM] += frames[count].length
        count += 1
    return count


prepare()
decode = export_decode(decode_kernel)
clock_doubles = sizeof(DeviceClock) // 8
emulated_encode = export_encode(send_encode)
