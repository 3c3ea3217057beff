# cython: freethreading_compatible=True
"""Packets of a microcontroller in a byte stream: typed fields in COBS with a checksum, or lines of numbers.

    packet    counter (one byte), fields, checksum, least significant byte first; COBS-encoded, with a zero at the end
    line      counter and numbers, separated by commas, a line feed at the end; a line that begins with # is a comment

The rest of a packet without its beginning, at the start or after a gap, does not count as corrupt. The rest of a line
is skipped: without its first digits a number is wrong, and no checksum reveals it.
"""

from libc.math cimport fmod, isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t, uint64_t
from libc.stdio cimport snprintf
from libc.string cimport memcpy, memset

from cext.abi cimport (
    FRAME_BYTES, ITEMS, MALFORMED, NOTED, NOT_FINITE, TAKEN, TIME, Frame, Rest, decode_t, each, encode_t,
    export_decode, export_encode, items,
)
from cext.kernels.devices.clock_map cimport DeviceClock, sampled
from cext.kernels.devices.cobs cimport checksum, stuff, unstuff
from cext.kernels.devices.fields_of_bytes cimport number, put_number, size_of
from cext.kernels.devices.sequence cimport missing_before
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

cdef enum: # in `plan`, followed by the type and scale of each field
    LINES                       # whether packets come as lines
    COUNTED                     # whether there is a counter
    SIZE                        # bytes of a packet's fields
    FIRST_FIELD

cdef enum: # in `parsed`
    FILLED                      # bytes in `buffer`
    WHOLE                       # whether it was received from its beginning
    TOO_LONG

cdef enum: # in `state`
    NUMBER                      # counter of the next packet
    DUE                         # s
    LUCK
    FROM                        # range of the bytes to be sent
    UNTIL

cdef enum:
    PACKET_LIMIT = 256          # bytes of an encoded packet
    LINE = 1024                 # bytes of a line


cdef struct Driver:
    int32_t age, received, lost, late, corrupt, sample_time, clock_drift
    int32_t plan                # the enum above
    int32_t parsed              # the enum above
    int32_t sequence            # see cext/kernels/devices/sequence.pxd
    int32_t buffer              # bytes of the packet that is being received
    # index of the device's clock among the numbers, -1: none; s per count; s until it wraps, 0: never
    int32_t clock_plan
    int32_t mapped              # a DeviceClock
    Rest outputs                # fields, in the order of `plan`

DRIVER = items((<Driver *>ITEMS)[0], "plan[...] parsed[3] sequence[3] buffer[...] clock_plan[3] mapped[46]")


cdef inline int fields(int plan_size) noexcept nogil:
    return (plan_size - FIRST_FIELD) // 2


cdef void put(double *arena, const Driver *at, const Driver *sizes, const double *plan,
        const double *values) noexcept nogil:
    """Write the scaled values of a packet to the outputs."""
    cdef int field, i
    cdef int offset = 0
    cdef double *y
    for field in range(fields(sizes.plan)):
        y = arena + each(at, at.outputs)[field]
        for i in range(each(sizes, sizes.outputs)[field]):
            y[i] = values[offset] * plan[FIRST_FIELD + 2 * field + 1]
            offset += 1


cdef bint is_ahead(double *arena, const Driver *at, uint32_t counter, double came) noexcept nogil:
    """Count the packets that are missing before one, by its counter. Returns False if it is late or repeated."""
    cdef int missing = 0
    if (arena + at.plan)[COUNTED] != 0.0:
        missing = missing_before(arena + at.sequence, counter, 0xFF, came)
    arena[at.late] += missing < 0
    arena[at.lost] += max(missing, 0)
    return missing >= 0


cdef void note_packet(double *arena, const Driver *at, const double *values, double came) noexcept nogil:
    """Count a packet, and set its sampling time by its own clock, else its arrival. came : s, arrival"""
    cdef const double *plan = arena + at.clock_plan
    cdef DeviceClock *clock = <DeviceClock *>(arena + at.mapped)
    if plan[0] >= 0.0:
        came = sampled(clock, values[<int>plan[0]] * plan[1], plan[2], came)
        arena[at.clock_drift] = clock.map.slope
    arena[at.sample_time] = came
    arena[at.received] += 1.0


cdef int packet(double *arena, const Driver *at, const Driver *sizes, double *state, const double *plan, uint8_t *data,
                double came) noexcept nogil:
    """Decode the bytes before a zero. Returns TAKEN or MALFORMED."""
    cdef double[PACKET_LIMIT] values
    cdef int size = <int>plan[SIZE]
    cdef int counted = <int>plan[COUNTED]
    cdef int length = unstuff(data, <int>state[FILLED])
    cdef int offset = counted
    cdef int values_count = 0
    cdef int field, i, kind
    if length != counted + size + 2 or checksum(data, length - 2) != (data[length - 2] | data[length - 1] << 8):
        return MALFORMED
    for field in range(fields(sizes.plan)):
        kind = <int>plan[FIRST_FIELD + 2 * field]
        for i in range(each(sizes, sizes.outputs)[field]):
            values[values_count] = number(data + offset, kind)
            values_count += 1
            offset += size_of(kind)
    if not is_ahead(arena, at, data[0], came):
        return NOTED
    put(arena, at, sizes, plan, values)
    note_packet(arena, at, values, came)
    return TAKEN


cdef int line(double *arena, const Driver *at, const Driver *sizes, double *state, const double *plan, uint8_t *data,
              double came) noexcept nogil:
    """Decode the text before a line feed. Returns TAKEN, NOTED for a comment, or MALFORMED."""
    cdef double[PACKET_LIMIT] values
    cdef int length = <int>state[FILLED]
    cdef int wanted = <int>plan[COUNTED]
    cdef int counted = wanted
    cdef char *offset = <char *>data
    cdef char *after = NULL
    cdef int field, i
    for field in range(fields(sizes.plan)):
        wanted += each(sizes, sizes.outputs)[field]
    while length > 0 and (data[length - 1] == 13 or data[length - 1] == 32 or data[length - 1] == 9):
        length -= 1
    data[length] = 0
    if length == 0 or data[0] == 35:
        return NOTED
    for i in range(wanted):
        values[i] = number_of(offset, &after)
        if after == offset:
            return MALFORMED
        offset = after
        while offset[0] == 32 or offset[0] == 9:
            offset += 1
        if offset[0] != (44 if i < wanted - 1 else 0):
            return MALFORMED
        offset += 1
    if offset - 1 != <char *>data + length:             # contains a zero
        return MALFORMED
    if counted and not 0.0 <= values[0] < 4294967296.0:
        return MALFORMED
    if not is_ahead(arena, at, <uint32_t>values[0] if counted else 0, came):
        return NOTED
    put(arena, at, sizes, plan, values + counted)
    note_packet(arena, at, values + counted, came)
    return TAKEN


cdef int decode_kernel(double *arena, const Driver *at, const Driver *sizes, const Frame *frame) noexcept nogil:
    cdef const double *plan = arena + at.plan
    cdef double *state = arena + at.parsed
    cdef uint8_t *data = <uint8_t *>(arena + at.buffer)
    cdef bint lines = plan[LINES] != 0.0
    cdef uint8_t end = 10 if lines else 0
    cdef int room = (LINE if lines else PACKET_LIMIT) - 1
    cdef bint taken = False
    cdef bint corrupt = False
    cdef int i, answer
    # the line was lost or restored, or bytes were lost: the packet so far remains incomplete
    if frame.id != BYTES or frame.flags & GAP:
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
            answer = (line if lines else packet)(arena, at, sizes, state, plan, data, frame.time * 1e-9)
        if answer == TAKEN:
            taken = True
        elif answer == MALFORMED and state[WHOLE] != 0.0:
            corrupt = True
            arena[at.corrupt] += 1.0
        state[FILLED] = state[TOO_LONG] = 0.0
        state[WHOLE] = 1.0
    return TAKEN if taken else MALFORMED if corrupt else NOTED


cdef struct Emulated:
    int32_t silent, dropped, broken, period
    int32_t plan, state         # the enums above
    int32_t clock_plan          # as in the driver
    int32_t waiting             # bytes to be sent
    Rest inputs                 # fields, in the order of `plan`

EMULATED = items((<Emulated *>ITEMS)[0], "plan[...] state[5] clock_plan[3] waiting[...]")


cdef double count_of(const double *arena, const Emulated *at, double scale, int slot, int index) noexcept nogil:
    """Return the number to be sent for an input. The device clock is the time of the plant plus its input."""
    cdef const double *clock = arena + at.clock_plan
    cdef double count = arena[slot] / scale
    if index == <int>clock[0]:
        count += arena[TIME] / clock[1]
        if clock[2] > 0.0:
            count = fmod(count, clock[2] / clock[1])
    return count


cdef int make_packet(double *arena, const Emulated *at, const Emulated *sizes, const double *plan, double counter,
        uint8_t *out) noexcept nogil:
    cdef uint8_t[PACKET_LIMIT] plain
    cdef int offset = 0
    cdef int index = 0
    cdef int field, i, kind
    cdef int crc
    if plan[COUNTED] != 0.0:
        plain[0] = <uint8_t>counter
        offset = 1
    for field in range(fields(sizes.plan)):
        kind = <int>plan[FIRST_FIELD + 2 * field]
        for i in range(each(sizes, sizes.inputs)[field]):
            put_number(plain + offset, kind, count_of(arena, at, plan[FIRST_FIELD + 2 * field + 1],
                each(at, at.inputs)[field] + i, index))
            offset += size_of(kind)
            index += 1
    crc = checksum(plain, offset)
    plain[offset], plain[offset + 1] = <uint8_t>crc, <uint8_t>(crc >> 8)
    return stuff(plain, offset + 2, out)


cdef int make_line(double *arena, const Emulated *at, const Emulated *sizes, const double *plan, double counter,
        uint8_t *out) noexcept nogil:
    cdef char *text = <char *>out
    cdef int offset = 0
    cdef int index = 0
    cdef int field, i
    if plan[COUNTED] != 0.0:
        offset = snprintf(text, LINE, "%d,", <int>counter)
    for field in range(fields(sizes.plan)):
        for i in range(each(sizes, sizes.inputs)[field]):
            offset += snprintf(text + offset, LINE - offset, "%.10g,", count_of(arena, at,
                plan[FIRST_FIELD + 2 * field + 1], each(at, at.inputs)[field] + i, index))
            index += 1
    text[offset - 1] = 10
    return offset


cdef int send_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef const double *plan = arena + at.plan
    cdef double *state = arena + at.state
    cdef uint8_t *out = <uint8_t *>(arena + at.waiting)
    cdef int count = 0
    cdef int field, i
    for field in range(fields(sizes.plan)):
        for i in range(each(sizes, sizes.inputs)[field]):
            if not isfinite(arena[each(at, at.inputs)[field] + i]):
                return -NOT_FINITE
    if state[FROM] >= state[UNTIL] and arena[TIME] >= state[DUE] - 1e-9:
        state[DUE] += arena[at.period]
        if state[DUE] < arena[TIME]:
            state[DUE] = arena[TIME] + arena[at.period]
        state[FROM] = 0.0
        state[UNTIL] = (make_line if plan[LINES] != 0.0 else make_packet)(arena, at, sizes, plan, state[NUMBER], out)
        state[NUMBER] = <double>((<int>state[NUMBER] + 1) & 0xFF)
        if arena[at.silent] != 0.0 or lucky(&state[LUCK], arena[at.dropped]):
            state[UNTIL] = 0.0
        elif lucky(&state[LUCK], arena[at.broken]):
            out[<int>state[UNTIL] // 2] ^= 0x15
    while state[FROM] < state[UNTIL] and count < 4:
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].length = <uint8_t>min(FRAME_BYTES, <int>(state[UNTIL] - state[FROM]))
        memcpy(frames[count].data, out + <int>state[FROM], frames[count].length)
        state[FROM] += frames[count].length
        count += 1
    return count


prepare()
decode = export_decode(<decode_t>decode_kernel, DRIVER)
clock_doubles = sizeof(DeviceClock) // 8
emulated_encode = export_encode(<encode_t>send_encode, EMULATED)
