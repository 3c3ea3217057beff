# cython: freethreading_compatible=True
"""Pressure insoles: frames of pressures in a byte stream, their sums, and the detection of steps.

    0   "SOLE"          4   version, 1          5   side, 0 left, 1 right       6   number of the frame, two bytes
    8   rows            9   columns            10   reserved, two bytes        12   µs of the sender's clock, four bytes
   16   pressures of the cells, row by row from the heel, in each row from the wearer's left, two bytes each, in 10 Pa;
        65535: no cell
        CRC-16/CCITT-FALSE of all before it, two bytes

Least significant bytes first. A frame with a wrong checksum is dropped, and the search resumes after its first byte.
"""

from libc.math cimport NAN, fabs, isfinite, rint
from libc.stdint cimport int32_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy, memmove, memset

from cext.abi cimport (
    DT, FRAME_BYTES, ITEMS, MALFORMED, NOTED, NOT_FINITE, OK, TAKEN, TIME, Frame, decode_t, encode_t, export,
    export_decode, export_encode, items, kernel_t,
)
from cext.kernels.devices.clock_map cimport DeviceClock, sampled
from cext.kernels.devices.cobs cimport checksum
from cext.kernels.devices.sequence cimport missing_before
from cext.kernels.bernoulli cimport lucky
from cext.kernels.limits cimport clip
from cext.ring.newest_ring cimport GAP, START
from cext.lines.stream_frames cimport BYTES

cdef enum: # in `plan`
    ROWS, COLUMNS, SIDE, LENGTH, WIDTH, FORCE_MINIMUM, DATAGRAMS, CLOCKED

cdef enum: # in `parsed`
    FILLED
    WHOLE                       # whether a frame ended directly before this one

cdef enum:
    HEADER = 16
    NO_CELL = 65535
    UNIT = 10                   # Pa
    FRAME_LIMIT = 65536         # bytes of an emulated frame

cdef enum: # in `state` of an emulated insole
    NUMBER, DUE, LUCK, FROM, UNTIL

cdef double ROUND = 4294.967296 # s, period of a clock of 32 bits in µs


cdef inline uint32_t u16(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8


cdef inline void put16(uint8_t *data, uint32_t value) noexcept nogil:
    data[0], data[1] = <uint8_t>value, <uint8_t>(value >> 8)


cdef inline int bytes_of(const double *plan) noexcept nogil:
    return HEADER + 2 * <int>plan[ROWS] * <int>plan[COLUMNS] + 2


cdef inline bint begins(const uint8_t *data, int count) noexcept nogil:
    """Return whether these bytes may be the start of a frame."""
    return ((count < 1 or data[0] == 83) and (count < 2 or data[1] == 79) and (count < 3 or data[2] == 76)
        and (count < 4 or data[3] == 69)
            and (count < 5 or data[4] == 1))


cdef void look_on(double *state, uint8_t *data) noexcept nogil:
    """Drop the first byte: the next frame may begin after it."""
    cdef int filled = <int>state[FILLED]
    cdef int at = 1
    while at < filled and not begins(data + at, filled - at):
        at += 1
    memmove(data, data + at, filled - at)
    state[FILLED] = filled - at


cdef struct Insole:
    int32_t force, centre, regions, received, lost, late, corrupt, dead, sample_time, clock_drift
    int32_t plan                # the enum above
    int32_t bounds              # rows at which regions begin, the first 0
    int32_t parsed              # the enum above
    int32_t sequence            # see cext/kernels/devices/sequence.pxd
    int32_t buffer              # bytes of the frame that is being received
    int32_t mapped              # a DeviceClock

INSOLE = items((<Insole *>ITEMS)[0], "centre[2] regions[...] plan[8] bounds[...] parsed[2] sequence[3] buffer[...] mapped[46]")


cdef void sum_up(double *arena, const Insole *at, const Insole *sizes, const double *plan,
        const uint8_t *cells) noexcept nogil:
    """Compute force, centre of pressure and sums of regions. x is forward from the heel, y left from the middle."""
    cdef const double *bounds = arena + at.bounds
    cdef double *regions = arena + at.regions
    cdef int rows = <int>plan[ROWS]
    cdef int columns = <int>plan[COLUMNS]
    cdef double area = plan[LENGTH] * plan[WIDTH] / (rows * columns)
    cdef double total = 0.0
    cdef double along = 0.0
    cdef double across = 0.0
    cdef double pressed
    cdef int dead = 0
    cdef int region = 0
    cdef int row, column, i
    cdef uint32_t raw
    for i in range(sizes.regions):
        regions[i] = 0.0
    for row in range(rows):
        while region + 1 < sizes.regions and row >= bounds[region + 1]:
            region += 1
        for column in range(columns):
            raw = u16(cells + 2 * (row * columns + column))
            if raw == NO_CELL:
                dead += 1
                continue
            pressed = UNIT * <double>raw * area
            total += pressed
            along += pressed * (row + 0.5)
            across += pressed * (0.5 * columns - column - 0.5)
            regions[region] += pressed
    arena[at.force] = total
    arena[at.centre] = along / total * plan[LENGTH] / rows if total >= plan[FORCE_MINIMUM] else NAN
    arena[at.centre + 1] = across / total * plan[WIDTH] / columns if total >= plan[FORCE_MINIMUM] else NAN
    arena[at.dead] = dead


cdef int whole_frame(double *arena, const Insole *at, const Insole *sizes, const double *plan, const uint8_t *data,
                     double came) noexcept nogil:
    """Return TAKEN, NOTED for a frame of the other foot and for one that is late, or MALFORMED."""
    cdef int size = bytes_of(plan)
    cdef int missing
    cdef DeviceClock *clock = <DeviceClock *>(arena + at.mapped)
    if checksum(data, size - 2) != u16(data + size - 2):
        return MALFORMED
    if data[8] != <int>plan[ROWS] or data[9] != <int>plan[COLUMNS]:
        return MALFORMED
    if data[5] != <int>plan[SIDE]:
        return NOTED
    missing = missing_before(arena + at.sequence, u16(data + 6), 0xFFFF, came)
    if missing < 0:
        arena[at.late] += 1.0
        return NOTED
    arena[at.lost] += missing
    sum_up(arena, at, sizes, plan, data + HEADER)
    if plan[CLOCKED] != 0.0:
        came = sampled(clock, 1e-6 * (u16(data + 12) | u16(data + 14) << 16), ROUND, came)
        arena[at.clock_drift] = clock.map.slope
    arena[at.sample_time] = came
    arena[at.received] += 1.0
    return TAKEN


cdef int decode_kernel(double *arena, const Insole *at, const Insole *sizes, const Frame *frame) noexcept nogil:
    cdef const double *plan = arena + at.plan
    cdef double *state = arena + at.parsed
    cdef uint8_t *data = <uint8_t *>(arena + at.buffer)
    cdef int size = bytes_of(plan)
    cdef bint taken = False
    cdef bint corrupt = False
    cdef int i, answer
    if frame.id != BYTES or frame.flags & GAP or (frame.flags & START and plan[DATAGRAMS] != 0.0):
        if frame.id == BYTES and not frame.flags & GAP and state[FILLED] > 0.0:     # a truncated datagram
            arena[at.corrupt] += 1.0
            corrupt = True
        state[FILLED] = 0.0
        state[WHOLE] = frame.id == BYTES and plan[DATAGRAMS] != 0.0
    if frame.id != BYTES:
        return NOTED
    for i in range(frame.length):
        data[<int>state[FILLED]] = frame.data[i]
        state[FILLED] += 1.0
        if state[FILLED] <= 5.0 and not begins(data, <int>state[FILLED]):
            if state[WHOLE] != 0.0:                                                 # not a frame; counted once
                arena[at.corrupt] += 1.0
                corrupt = True
                state[WHOLE] = 0.0
            look_on(state, data)
        if state[FILLED] < size:
            continue
        answer = whole_frame(arena, at, sizes, plan, data, frame.time * 1e-9)
        if answer == MALFORMED:
            if state[WHOLE] != 0.0:
                arena[at.corrupt] += 1.0
                corrupt = True
                state[WHOLE] = 0.0
            look_on(state, data)
            continue
        taken = taken or answer == TAKEN
        state[FILLED] = 0.0
        state[WHOLE] = 1.0
    return TAKEN if taken else MALFORMED if corrupt else NOTED


cdef enum:
    CELLS_LIMIT = 120           # cells in a row or a column


cdef void spread(double centre, int count, double reach, double *weights) noexcept nogil:
    """Distribute a load over cells as a triangle with an integer reach, whose mean is the centre but near an edge."""
    cdef double total = 0.0
    cdef int i
    centre = clip(centre, 0.0, count - 1.0)
    for i in range(count):
        weights[i] = max(1.0 - fabs(i - centre) / reach, 0.0)
        total += weights[i]
    for i in range(count):
        weights[i] /= total


cdef struct Emulated:
    int32_t force, centre, silent, dropped, broken, period, plan, state
    int32_t waiting             # bytes to be sent

EMULATED = items((<Emulated *>ITEMS)[0], "centre[2] plan[8] state[5] waiting[...]")


cdef int make_frame(double *arena, const Emulated *at, const double *plan, double number, uint8_t *out) noexcept nogil:
    cdef int rows = <int>plan[ROWS]
    cdef int columns = <int>plan[COLUMNS]
    cdef double area = plan[LENGTH] * plan[WIDTH] / (rows * columns)
    cdef double at_row = arena[at.centre] * rows / plan[LENGTH] - 0.5
    cdef double at_column = 0.5 * columns - 0.5 - arena[at.centre + 1] * columns / plan[WIDTH]
    cdef double[CELLS_LIMIT] along
    cdef double[CELLS_LIMIT] across
    cdef double raw
    cdef int size = bytes_of(plan)
    cdef int row, column
    cdef uint32_t micros = <uint32_t>(<uint64_t>(arena[TIME] * 1e6) & 0xFFFFFFFFu)
    spread(at_row, rows, rows // 4 if rows >= 8 else 1, along)
    spread(at_column, columns, columns // 2 if columns >= 4 else 1, across)
    memset(out, 0, HEADER)
    memcpy(out, "SOLE", 4)
    out[4], out[5] = 1, <uint8_t>plan[SIDE]
    put16(out + 6, <uint32_t>number)
    out[8], out[9] = <uint8_t>rows, <uint8_t>columns
    put16(out + 12, micros)
    put16(out + 14, micros >> 16)
    for row in range(rows):
        for column in range(columns):
            raw = rint(arena[at.force] * along[row] * across[column] / (area * UNIT))
            put16(out + HEADER + 2 * (row * columns + column), 0 if not raw > 0.0 else NO_CELL - 1 if raw >= NO_CELL
                else <uint32_t>raw)
    put16(out + size - 2, checksum(out, size - 2))
    return size


cdef int send_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef const double *plan = arena + at.plan
    cdef double *state = arena + at.state
    cdef uint8_t *out = <uint8_t *>(arena + at.waiting)
    cdef int count = 0
    cdef int place
    if not isfinite(arena[at.force] + arena[at.centre] + arena[at.centre + 1]):
        return -NOT_FINITE
    if state[FROM] >= state[UNTIL] and arena[TIME] >= state[DUE] - 1e-9:
        state[DUE] += arena[at.period]
        if state[DUE] < arena[TIME]:
            state[DUE] = arena[TIME] + arena[at.period]
        state[FROM] = 0.0
        state[UNTIL] = make_frame(arena, at, plan, state[NUMBER], out)
        state[NUMBER] = <double>((<int>state[NUMBER] + 1) & 0xFFFF)
        if arena[at.silent] != 0.0 or lucky(&state[LUCK], arena[at.dropped]):
            state[UNTIL] = 0.0
        elif lucky(&state[LUCK], arena[at.broken]):
            place = <int>state[UNTIL] // 2
            out[place] = out[place] ^ 0x15
    while state[FROM] < state[UNTIL] and count < 4:
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].flags = START if state[FROM] == 0.0 else 0
        frames[count].length = <uint8_t>min(FRAME_BYTES, <int>(state[UNTIL] - state[FROM]))
        memcpy(frames[count].data, out + <int>state[FROM], frames[count].length)
        state[FROM] += frames[count].length
        count += 1
    return count


cdef struct Contact:
    int32_t force, heel, contact, heel_strike, toe_off, press, release, heel_share, shortest
    int32_t state               # whether the foot is on the ground; time since that change, s

CONTACT = items((<Contact *>ITEMS)[0], "state[2]")


cdef int contact_kernel(double *arena, const Contact *at, const Contact *sizes) noexcept nogil:
    cdef double *state = arena + at.state
    cdef double force = arena[at.force]
    cdef double heel = arena[at.heel]
    cdef bint down = state[0] != 0.0
    arena[at.heel_strike] = arena[at.toe_off] = 0.0
    state[1] += arena[DT]
    if state[1] >= arena[at.shortest]:
        if not down and force >= arena[at.press]:
            state[0], state[1] = 1.0, 0.0
            arena[at.heel_strike] = heel >= arena[at.heel_share] * force
        elif down and force < arena[at.release]:
            state[0], state[1] = 0.0, 0.0
            arena[at.toe_off] = 1.0
    arena[at.contact] = state[0]
    return OK


decode = export_decode(<decode_t>decode_kernel, INSOLE)
clock_doubles = sizeof(DeviceClock) // 8
emulated_encode = export_encode(<encode_t>send_encode, EMULATED)
contact = export(<kernel_t>contact_kernel, CONTACT)
