# cython: freethreading_compatible=True
"""MicroStrain sensors: decoding of a byte stream that may be split anywhere and contain anything.

A table made by the block (blocks.imus.microstrain.descriptors) defines the fields, one row per descriptor. Its index
has three parts: for the sets 80 (sensor), 82 (filter), and any other, of which only the shared fields are known.
"""

from libc.math cimport NAN, asin, atan2, isfinite, sqrt
from libc.stdint cimport int32_t
from libc.string cimport memset

from cext.abi cimport (
    ITEMS, MALFORMED, NOTED, OK, TAKEN, Rest, decode_t, each, encode_t, export, export_decode, export_encode, items,
    kernel_t,
)
from cext.kernels.devices.clock_map cimport ClockMap, mapped
from cext.lines.stream_frames cimport BACK, LOST

cdef enum: # types of a field's values
    FLOAT, DOUBLE, UNSIGNED_8, UNSIGNED_16, UNSIGNED_32, UNSIGNED_64

cdef enum: # special meanings of a field
    PLAIN, ATTITUDE, ANGLES, CLOCK

cdef enum: # states of a tare
    IDLE = -1
    WANTED = -2

cdef double SET_WAIT = 0.5      # s after the first packet; a sensor without a filter sends no set of it

cdef struct Row:                # row of the table
    double role
    double kind
    double count                # values
    double scale                # to SI
    double item                 # destination item, -1: none
    double flagged              # whether a validity word follows
    double first                # bytes before the values

cdef struct Settings:
    double rate                 # Hz
    double tare_time            # s
    double tare_at_start
    double primary              # index of the set whose rate is reported
    double sets                 # requested sets, one bit each

cdef struct State:
    ClockMap clock
    double begun
    double last[2]              # newest time stamp of each set, s; 0: none
    double counted              # packets in the present second
    double since                # start of the present second
    double asked                # input `tare` of the previous tick
    double taring               # start of the tare, s; WANTED: with the next sample; IDLE
    double sum[4]
    double attitude             # in the packet: 0 none, 1 as angles, 2 as a quaternion
    double valid                # validity flag of the filter for the packet; below 0: none
    double time                 # time stamp of the packet, s, NaN: none
    double received             # sets received since the newest whole sample, one bit each
    double sent                 # sets that the sensor sends
    double awaited_until        # s, end of the wait for the requested sets that have not been received


cdef struct Measured:
    int32_t accel, gyro, mag, quaternion, euler, rotation, raw_quaternion, raw_euler, temperature

cdef struct MicroStrain:
    Measured measured
    int32_t tare, age, sample_time, clock_drift, measured_rate, packets, corrupt, lost, valid, tared, tare_attitude
    int32_t connected
    int32_t pending             # a Pending
    int32_t index, rows         # the table
    int32_t settings            # Settings
    int32_t state               # State
    Rest outputs                # rest of the channels with an output of their own

MICRO_STRAIN = items(
    (<MicroStrain *>ITEMS)[0],
    "accel[3] gyro[3] mag[3] quaternion[4] euler[3] rotation[9] raw_quaternion[4] raw_euler[3] tare_attitude[4] "
    "pending[65] index[768] rows[...] settings[5] state[72]")


cdef inline int32_t place_of(const MicroStrain *at, int item) noexcept nogil:
    """Return the position of an item of the table: in the struct, or after its items, in `outputs`."""
    cdef int named = (sizeof(MicroStrain) - sizeof(Rest)) // sizeof(int32_t)
    return (<const int32_t *>at)[item] if item < named else each(at, at.outputs)[item - named]


cdef inline State *state_of(double *arena, const MicroStrain *at) noexcept nogil:
    return <State *>(arena + at.state)


cdef inline double value_at(const uint8_t *data, int kind, int index) noexcept nogil:
    if kind == FLOAT:
        return float_32(data + 4 * index)
    if kind == DOUBLE:
        return float_64(data + 8 * index)
    if kind == UNSIGNED_8:
        return data[index]
    if kind == UNSIGNED_16:
        return <double>(<uint16_t>data[2 * index] << 8 | data[2 * index + 1])
    if kind == UNSIGNED_32:
        return big_32(data + 4 * index)
    return <double>big_64(data + 8 * index)


cdef inline int width_of(int kind) noexcept nogil:
    return 8 if kind == DOUBLE or kind == UNSIGNED_64 else 1 if kind == UNSIGNED_8 else 2 if kind == UNSIGNED_16 else 4


cdef void take_field(double *arena, const MicroStrain *at, int set_index, const uint8_t *field) noexcept nogil:
    cdef int number = <int>(arena + at.index)[256 * set_index + field[1]]
    cdef State *state = state_of(arena, at)
    cdef const Row *row
    cdef const uint8_t *data
    cdef double *target
    cdef double value = 0.0
    cdef int index, kind, count, size
    cdef bint valid = True
    if number == 0:
        return
    row = <const Row *>(arena + at.rows) + number - 1
    kind, count = <int>row.kind, <int>row.count
    size = width_of(kind) * count
    data = field + 2 + <int>row.first
    if field[0] - 2 - <int>row.first < size + (2 if row.flagged != 0.0 else 0):
        return
    if row.flagged != 0.0:
        valid = data[size] != 0 or data[size + 1] != 0
        state.valid = 0.0 if not valid or state.valid == 0.0 else 1.0
    if row.role == CLOCK:
        value = value_at(data, kind, 0) * row.scale
        if isfinite(value) and not state.time == state.time:       # first of several
            state.time = value
    if row.item < 0.0:
        return
    target = arena + place_of(at, <int>row.item)
    if kind == FLOAT and valid:
        for index in range(count):
            target[index] = float_32(data + 4 * index) * row.scale
    else:
        for index in range(count):
            target[index] = value_at(data, kind, index) * row.scale if valid else NAN
    if row.role == ATTITUDE:
        state.attitude = 2.0
    elif row.role == ANGLES and state.attitude == 0.0:
        state.attitude = 1.0


cdef bint is_whole(const uint8_t *packet) noexcept nogil:
    """Return whether the fields fill the payload."""
    cdef int at = HEAD
    cdef int end = HEAD + packet[3]
    while at < end:
        if packet[at] < 2 or at + packet[at] > end:
            return False
        at += packet[at]
    return True


cdef bint take_packet(double *arena, const MicroStrain *at, const MicroStrain *sizes, const uint8_t *packet,
        double came) noexcept nogil:
    """Decode a packet with a correct checksum. Returns whether it completes a sample of all requested sets.

    came : s, arrival
    """
    cdef State *state = state_of(arena, at)
    cdef int offset = HEAD
    cdef int end = HEAD + packet[3]
    cdef int set_index = 0 if packet[2] == 0x80 else 1 if packet[2] == 0x82 else 2
    if packet[2] < 0x80 or packet[3] == 0 or not is_whole(packet):
        return False
    if state.begun == 0.0:
        begin(arena, at, sizes, came)
    state.attitude, state.time, state.valid = 0.0, NAN, -1.0
    while offset < end:
        take_field(arena, at, set_index, packet + offset)
        offset += packet[offset]
    if state.valid >= 0.0:
        arena[at.valid] = state.valid
    arena[at.packets] += 1.0
    if set_index < 2:
        count_losses(arena, at, state, set_index)
    if state.time == state.time:
        arena[at.sample_time] = mapped(&state.clock, state.time, came)
        arena[at.clock_drift] = state.clock.slope
    else:
        arena[at.sample_time] = came
    measure_rate(arena, at, state, set_index, came)
    if state.attitude != 0.0:
        turn(arena, at, state, came)
    return completes(state, <int>(<const Settings *>(arena + at.settings)).sets, set_index, came)


cdef bint completes(State *state, int requested, int set_index, double came) noexcept nogil:
    """Return whether a packet completes a sample: every set of the sensor has been received since the newest one.

    requested : bits of the requested sets, all of which a sample needs at first; after SET_WAIT, those that the sensor
        sends
    """
    cdef int sent = <int>state.sent
    cdef int received = <int>state.received
    cdef int needed
    if set_index == 2:
        return False
    sent |= 1 << set_index
    received |= 1 << set_index
    needed = requested if came < state.awaited_until else requested & sent
    state.sent = <double>sent
    state.received = 0.0 if received & needed == needed else <double>received
    return state.received == 0.0


cdef void begin(double *arena, const MicroStrain *at, const MicroStrain *sizes, double came) noexcept nogil:
    cdef State *state = state_of(arena, at)
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    state.begun = 1.0
    state.since, state.taring = came, IDLE
    # a start and each further arming reset the state and keep the outputs
    if arena[at.packets] == 0.0:
        state.awaited_until = came + SET_WAIT
        blank(arena, at, sizes)
        arena[at.valid] = (arena + at.tare_attitude)[0] = 1.0
    if settings.tare_at_start != 0.0 and arena[at.tared] == 0.0:
        state.taring = WANTED


cdef void blank(double *arena, const MicroStrain *at, const MicroStrain *sizes) noexcept nogil:
    """Set the outputs of values that have not been received to NaN."""
    cdef int item, index
    for item in range(sizeof(Measured) // sizeof(int32_t)):
        for index in range((<const int32_t *>&sizes.measured)[item]):
            arena[(<const int32_t *>&at.measured)[item] + index] = NAN
    for item in range(at.outputs.count):
        for index in range(each(sizes, sizes.outputs)[item]):
            arena[each(at, at.outputs)[item] + index] = NAN


cdef void count_losses(double *arena, const MicroStrain *at, State *state, int set_index) noexcept nogil:
    """Count the samples that are missing by the time stamps."""
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef double gap
    if not state.time == state.time:
        return
    gap = (state.time - state.last[set_index]) * settings.rate
    if state.last[set_index] != 0.0 and 1.5 < gap < 60.0 * settings.rate:
        arena[at.lost] += <double><int64_t>(gap - 0.5)
    state.last[set_index] = state.time


cdef void measure_rate(double *arena, const MicroStrain *at, State *state, int set_index, double came) noexcept nogil:
    if set_index != <int>(<const Settings *>(arena + at.settings)).primary:
        return
    state.counted += 1.0
    if came - state.since >= 1.0:
        arena[at.measured_rate] = state.counted / (came - state.since)
        state.counted, state.since = 0.0, came


# Attitude

cdef void to_angles(const double *r, double *euler) noexcept nogil:
    """Compute roll, pitch and yaw of a rotation matrix."""
    euler[0] = atan2(r[7], r[8])
    euler[1] = -asin(max(-1.0, min(1.0, r[6]))) if r[6] == r[6] else NAN
    euler[2] = atan2(r[3], r[0])


cdef void turn(double *arena, const MicroStrain *at, State *state, double came) noexcept nogil:
    """Convert the sensor's attitude to the output: relative to the tared one."""
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef double q[4]
    cdef double *raw = arena + at.measured.raw_quaternion
    cdef double *output = arena + at.measured.quaternion
    cdef double norm, sign
    cdef int index
    if state.attitude == 1.0:
        from_angles(arena + at.measured.raw_euler, raw)
    norm = sqrt(raw[0] * raw[0] + raw[1] * raw[1] + raw[2] * raw[2] + raw[3] * raw[3])
    for index in range(4):
        q[index] = raw[index] / norm if norm > 0.1 else NAN
    if state.taring != IDLE and isfinite(q[0] + q[1] + q[2] + q[3]):
        if state.taring == WANTED:
            state.taring = came
            memset(state.sum, 0, sizeof(state.sum))
        sign = -1.0 if (
            q[0] * state.sum[0] + q[1] * state.sum[1] + q[2] * state.sum[2] + q[3] * state.sum[3] < 0.0) else 1.0
        for index in range(4):
            state.sum[index] += sign * q[index]
        if came - state.taring >= settings.tare_time:
            norm = sqrt(state.sum[0] * state.sum[0] + state.sum[1] * state.sum[1] + state.sum[2] * state.sum[2]
                + state.sum[3] * state.sum[3])
            for index in range(4):
                (arena + at.tare_attitude)[index] = state.sum[index] / norm
            state.taring, arena[at.tared] = IDLE, 1.0
    product(arena + at.tare_attitude, q, output)
    to_matrix(output, arena + at.measured.rotation)
    to_angles(arena + at.measured.rotation, arena + at.measured.euler)


# The device

cdef int mip_decode(double *arena, const MicroStrain *at, const MicroStrain *sizes, const Frame *frame) noexcept nogil:
    cdef Pending *pending = <Pending *>(arena + at.pending)
    cdef bint taken = False
    cdef int64_t corrupt = 0
    cdef double came = frame.time * 1e-9
    cdef int offset, need
    cdef int rounds
    if frame.id == LOST or frame.id == BACK:
        arena[at.connected] = frame.id == BACK
    elif frame.id == BYTES:
        arena[at.connected] = 1.0
    for rounds in range(2):
        if rounds == 0 and not (frame.flags & GAP or frame.id != BYTES):
            continue
        if rounds == 1:
            if frame.id != BYTES:
                break
            memcpy(pending.bytes + pending.length, frame.data, frame.length)
            pending.length += frame.length
        offset = 0
        while True:
            need = next_packet(pending.bytes, <int>pending.length, &offset, rounds == 0, &corrupt)
            if need == 0:
                break
            if take_packet(arena, at, sizes, pending.bytes + offset, came):
                taken = True
            offset += need
        pending.length -= offset
        memmove(pending.bytes, pending.bytes + offset, pending.length)
    arena[at.corrupt] += corrupt
    if taken and (<const Settings *>(arena + at.settings)).tare_at_start != 0.0 and arena[at.tared] == 0.0:
        return NOTED                                # arming waits for the tare
    return TAKEN if taken else MALFORMED if corrupt > 0 else NOTED


cdef int mip_encode(double *arena, const MicroStrain *at, const MicroStrain *sizes, Frame *frames) noexcept nogil:
    """Send nothing; check at the end of the tick whether a tare is requested."""
    cdef State *state = state_of(arena, at)
    cdef double asked = 1.0 if arena[at.tare] != 0.0 else 0.0
    if asked != 0.0 and state.asked == 0.0 and state.begun != 0.0:
        state.taring = WANTED
    state.asked = asked
    return 0


cdef int mip_kernel(double *arena, const MicroStrain *at, const MicroStrain *sizes) noexcept nogil:
    if arena[at.packets] == 0.0:
        blank(arena, at, sizes)
    return OK


decode = export_decode(<decode_t>mip_decode, MICRO_STRAIN)
encode = export_encode(<encode_t>mip_encode, MICRO_STRAIN)
before = export(<kernel_t>mip_kernel, MICRO_STRAIN)
