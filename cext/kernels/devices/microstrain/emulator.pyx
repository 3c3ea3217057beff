# cython: freethreading_compatible=True
"""Emulated MicroStrain sensor: replies to MIP commands and sends data, with injected faults of sensor and line.

Two generations differ in their commands. The older has a format for each set (0C 08, 0C 0A), streams 1 and 3, and
times since power-on in the fields 80 12 and 82 11; the newer has one format command (0C 0F), streams by their set, and
the shared field D5.
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint16_t, uint64_t
from libc.string cimport memcpy, memmove, memset

from cext.abi cimport (
    FRAMES_PER_DEVICE, FRAME_BYTES, ITEMS, TAKEN, TIME, Frame, decode_t, encode_t, export_decode, export_encode,
    items,
)
from cext.kernels.devices.microstrain.mip cimport (
    HEAD, LOAD, READ, RESET, SAVE, SYNC_1, SYNC_2, WRITE, Pending, finish, float_32, from_angles, next_packet, put_16,
    put_float,
)
from cext.kernels.devices.microstrain.truth cimport Truth, fill, mount
from cext.ring.newest_ring cimport START
from cext.lines.stream_frames cimport BACK, BYTES, LOST

cdef enum:
    FIELD_LIMIT = 16            # fields of a format
    OUTBOX = 4096               # bytes
    INFO = 82                   # bytes of the reply to device info
    FILTERED = 4                # fields of set 80 with a low-pass: 04, 05, 06, 17
    REGISTERS = 24              # further settings, and the bytes of each
    VALUE = 40
    WORDS = VALUE + 3           # numbers of each: command, descriptor of its reply, length, factory value

cdef struct Settings:
    double base_rate            # Hz
    double newer                # generation
    double clock_drift
    double clock_start          # s
    double seed

cdef struct Format:
    int32_t count
    uint8_t descriptor[FIELD_LIMIT]
    uint16_t decimation[FIELD_LIMIT]

cdef struct LowPass:
    int32_t enabled
    int32_t manual              # 0: the cutoff is half the rate of the field
    float cutoff                # Hz, if manual

cdef struct Setup:              # settings that can be saved
    Format format[2]            # of the sets 80 and 82
    int32_t streams[2]
    LowPass low_pass[FILTERED]
    uint8_t value[REGISTERS][VALUE]

cdef struct State:
    Pending inbox
    Setup now
    Setup saved
    int64_t idle
    int64_t begun
    int64_t sample              # number of the sample at the base rate
    int64_t gone
    uint64_t luck
    int64_t waiting             # bytes in the outbox
    uint8_t outbox[OUTBOX]
    int64_t corrupt


cdef inline double chance(State *state) noexcept nogil:
    """Return a uniformly distributed number from 0 to 1: xorshift64*. (Vigna 2016)"""
    state.luck ^= state.luck >> 12
    state.luck ^= state.luck << 25
    state.luck ^= state.luck >> 27
    return <double>((state.luck * <uint64_t>0x2545F4914F6CDD1D) >> 11) * (1.0 / 9007199254740992.0)


cdef struct Sensor:
    int32_t accel, gyro, mag, quaternion, temperature, silent, garbage, dropped, flipped, skipped, not_a_number
    int32_t uninitialised, disconnected, streaming, heading, cutoff, sent
    int32_t about               # bytes of the reply to device info
    int32_t known               # commands and fields, set << 8 | descriptor
    int32_t settings            # Settings
    int32_t power_on            # formats, and whether it streams
    int32_t registers           # further settings, which have no effect except the rotation
    int32_t state               # State

SENSOR = items(
    (<Sensor *>ITEMS)[0],
    "accel[3] gyro[3] mag[3] quaternion[4] about[82] known[...] settings[5] power_on[68] registers[...] state[...]")


cdef bint supports(double *arena, const Sensor *at, const Sensor *sizes, int descriptor_set,
        int descriptor) noexcept nogil:
    cdef double *known = arena + at.known
    cdef int count = sizes.known
    cdef int index
    for index in range(count):
        if known[index] == descriptor_set << 8 | descriptor:
            return True
    return False


cdef void post(double *arena, const Sensor *at, State *state, const uint8_t *data, int count) noexcept nogil:
    """Send bytes on the line, some of which are lost."""
    cdef int index
    cdef double dropped = arena[at.dropped]
    for index in range(count):
        if state.waiting < OUTBOX and not (dropped > 0.0 and chance(state) < dropped):
            state.outbox[state.waiting] = data[index]
            state.waiting += 1


# Commands

cdef int reply(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, int descriptor_set,
               const uint8_t *field) noexcept nogil:
    """Write the reply fields of a command, after the acknowledgement. Returns their length or the negated error
    code.
    """
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef double *about = arena + at.about
    cdef double *known = arena + at.known
    cdef const uint8_t *data = field + 2
    cdef int length = field[0] - 2
    cdef int command = descriptor_set << 8 | field[1]
    cdef int index, stream, count
    if not supports(arena, at, sizes, descriptor_set, field[1]):
        return -1
    if command == 0x0102:
        state.idle = 1
    elif command == 0x0106:
        state.idle = 0
    elif command == 0x017E:
        state.now, state.idle = state.saved, 0
    elif command == 0x0105:
        out[0], out[1] = 6, 0x83                    # no fault
        return 6
    elif command == 0x0103:
        out[0], out[1] = INFO + 2, 0x81
        for index in range(INFO):
            out[2 + index] = <uint8_t>about[index]
        return INFO + 2
    elif command == 0x0104 or command == 0x0107:
        count = sizes.known
        if command == 0x0104:
            count = min(count, 60)
            index = 0
        else:
            index = min(count, 60)
        out[0], out[1] = <uint8_t>(2 + 2 * (count - index)), 0x82 if command == 0x0104 else 0x86
        stream = 2
        while index < count:
            put_16(out + stream, <uint16_t>known[index])
            stream += 2
            index += 1
        return stream
    elif command == 0x0C06 or command == 0x0C0B:
        out[0], out[1] = 4, 0x83 if field[1] == 0x06 else 0x8A
        put_16(out + 2, <uint16_t>settings.base_rate)
        return 4
    elif command == 0x0C0E:
        if length < 1:
            return -3
        out[0], out[1], out[2] = 5, 0x8E, data[0]
        put_16(out + 3, <uint16_t>settings.base_rate)
        return 5
    elif command == 0x0C08 or command == 0x0C0A:
        return set_format(arena, at, sizes, state, out, 0 if field[1] == 0x08 else 1, field[1] + 0x78, data, length, 0)
    elif command == 0x0C0F:
        if length < 2 or (data[1] != 0x80 and data[1] != 0x82):
            return -3
        return set_format(arena, at, sizes, state, out, data[1] >> 1 & 1, 0x8F, data, length, 1)
    elif command == 0x0C11:
        if length < 2:
            return -3
        stream = data[1]
        if settings.newer != 0.0:
            stream = 0 if stream == 0x80 else 1 if stream == 0x82 else -1
        else:
            stream = 0 if stream == 1 else 1 if stream == 3 else -1
        if stream < 0 or (data[0] == WRITE and length < 3):
            return -3
        if data[0] == READ:
            out[0], out[1], out[2], out[3] = 4, 0x85, data[1], <uint8_t>state.now.streams[stream]
            return 4
        if data[0] == WRITE:
            state.now.streams[stream] = data[2] != 0
        elif data[0] == SAVE:
            state.saved.streams[stream] = state.now.streams[stream]
        elif data[0] == LOAD:
            state.now.streams[stream] = state.saved.streams[stream]
    elif command == 0x0C30:
        if length < 1 or not SAVE <= data[0] <= RESET:
            return -3
        if data[0] == SAVE:
            state.saved = state.now
        elif data[0] == LOAD:
            state.now = state.saved
        else:
            factory(arena, at, sizes, &state.now)
    elif command == 0x0C39:
        if length < 2:
            return -3
        out[0], out[1] = 14, 0x9B                   # the bias of an ideal gyroscope
        return 14
    elif command == 0x0C50 or command == 0x0C54:
        return low_pass(arena, at, sizes, state, out, field[1] == 0x54, data, length)
    elif command == 0x0D18:
        if length < 1:
            return -3
        if data[0] == READ:
            out[0], out[1], out[2] = 3, 0x87, <uint8_t>arena[at.heading]
            return 3
        if data[0] == WRITE:
            if length < 2 or data[1] > 1:
                return -3
            arena[at.heading] = data[1]
    elif command == 0x0D50:
        if length < 3:
            return -3
        if data[0] == READ:
            if data[1] != 0 or data[2] != 4:
                return -3
            out[0], out[1], out[2], out[3], out[4] = 5, 0xD0, data[1], data[2], <uint8_t>arena[at.heading]
            return 5
        if data[0] == WRITE:
            if length < 4 or data[1] != 0 or data[2] != 4 or not supports(arena, at, sizes, 0x80, 0x06):
                return -3                           # the only aiding source is its own magnetometer
            arena[at.heading] = data[3]
    else:
        return setting(arena, at, sizes, state, out, command, data, length)
    return 0


cdef int setting(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, int command,
        const uint8_t *data, int length) noexcept nogil:
    """Write, read, save, load or reset one of `registers`. A command that is not among them is only acknowledged."""
    cdef int index = register_of(arena, at, sizes, command)
    cdef int count, i
    cdef const double *row
    if index < 0:
        return 0
    row = arena + at.registers + WORDS * index
    count = <int>row[2]
    if length < 1 or (data[0] == WRITE and length < 1 + count):
        return -3
    if data[0] == READ:
        out[0], out[1] = <uint8_t>(2 + count), <uint8_t>row[1]
        memcpy(out + 2, state.now.value[index], count)
        return 2 + count
    if data[0] == WRITE:
        if not is_valid(command, data + 1, supports(arena, at, sizes, 0x80, 0x06)):
            return -3
        memcpy(state.now.value[index], data + 1, count)
    elif data[0] == SAVE:
        memcpy(state.saved.value[index], state.now.value[index], count)
    elif data[0] == LOAD:
        memcpy(state.now.value[index], state.saved.value[index], count)
    elif data[0] == RESET:
        for i in range(count):
            state.now.value[index][i] = <uint8_t>row[3 + i]
    else:
        return -3
    return 0


cdef int register_of(double *arena, const Sensor *at, const Sensor *sizes, int command) noexcept nogil:
    """Return the index of a command's setting, -1 for none."""
    cdef int index
    for index in range(sizes.registers // WORDS):
        if <int>arena[at.registers + WORDS * index] == command:
            return index
    return -1


cdef bint is_valid(int command, const uint8_t *data, bint has_magnetometer) noexcept nogil:
    cdef int i
    if command == 0x0C51:                           # up and north: enabled, 1 to 1000 s
        return (data[0] <= 1 and data[1] <= 1 and (data[1] == 0 or has_magnetometer)
            and 1.0 <= float_32(data + 2) <= 1000.0 and 1.0 <= float_32(data + 6) <= 1000.0)
    if command == 0x0D11 or command == 0x0C31:      # roll, pitch, yaw
        for i in range(3):
            if not isfinite(float_32(data + 4 * i)):
                return False
    return True


cdef bint mounting(double *arena, const Sensor *at, const Sensor *sizes, const State *state, double *q) noexcept nogil:
    """Compute the rotation from the vehicle's axes to the sensor's. Returns whether there is one.

    0C 31 has the angles of the sensor relative to the vehicle, 0D 11 those of the inverse.
    """
    cdef int newer = (<const Settings *>(arena + at.settings)).newer != 0.0
    cdef int index = register_of(arena, at, sizes, 0x0C31 if newer else 0x0D11)
    cdef double angles[3]
    cdef int i
    if index < 0:
        return False
    for i in range(3):
        angles[i] = float_32(state.now.value[index] + 4 * i)
    from_angles(angles, q)
    if newer:
        for i in range(1, 4):
            q[i] = -q[i]
    return angles[0] != 0.0 or angles[1] != 0.0 or angles[2] != 0.0


cdef inline int low_pass_of(int descriptor) noexcept nogil:
    """Return the index of a field's low-pass; FILTERED for all fields, below zero for a field without."""
    if 0x04 <= descriptor <= 0x06:
        return descriptor - 0x04
    return 3 if descriptor == 0x17 else (
        FILTERED if descriptor == 0 else -1)


cdef int low_pass(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, bint newer,
    const uint8_t *data,
                  int length) noexcept nogil:
    """0C 50: field, enabled, manual, cutoff u16, reserved; reply 8B. 0C 54: set, field, enabled, manual, cutoff f32;
    reply D4.
    """
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef int more = 1 if newer else 0
    cdef const uint8_t *values = data + 2 + more
    cdef int index, place, first
    cdef LowPass wanted
    if length < 2 + more or (newer and data[1] != 0x80 and (data[1] != 0 or data[2] != 0)):
        return -3
    place = low_pass_of(data[1 + more])
    if place < 0 or (place < FILTERED and not supports(arena, at, sizes, 0x80, data[1 + more])):
        return -3
    if data[0] == READ:
        if place == FILTERED:
            return -3                               # the setting of all fields cannot be read
        wanted = state.now.low_pass[place]
        if wanted.manual == 0:
            wanted.cutoff = <float>(0.5 * settings.base_rate)
            for index in range(state.now.format[0].count):
                if state.now.format[0].descriptor[index] == data[1 + more]:
                    wanted.cutoff = <float>(0.5 * settings.base_rate / state.now.format[0].decimation[index])
        memcpy(out + 2, data + 1, 1 + more)
        out[3 + more], out[4 + more] = <uint8_t>wanted.enabled, <uint8_t>wanted.manual
        if newer:
            put_float(out + 6, wanted.cutoff)
        else:
            put_16(out + 5, <uint16_t>wanted.cutoff)
        out[0], out[1] = 10 if newer else 8, 0xD4 if newer else 0x8B
        return out[0]
    if data[0] == WRITE:
        if length < (9 if newer else 7):
            return -3
        wanted.enabled, wanted.manual = values[0] != 0, values[1] != 0
        wanted.cutoff = <float>float_32(values + 2) if newer else <float>(<uint16_t>values[2] << 8 | values[3])
        first = 0 if place == FILTERED else place
        for index in range(first, FILTERED if place == FILTERED else place + 1):
            state.now.low_pass[index] = wanted
        arena[at.cutoff] = wanted.cutoff
    elif SAVE <= data[0] <= RESET:
        wanted.enabled, wanted.manual, wanted.cutoff = 1, 0, 0.0
        first = 0 if place == FILTERED else place
        for index in range(first, FILTERED if place == FILTERED else place + 1):
            if data[0] == SAVE:
                state.saved.low_pass[index] = state.now.low_pass[index]
            else:
                state.now.low_pass[index] = state.saved.low_pass[index] if data[0] == LOAD else wanted
    return 0


cdef int set_format(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, int which,
    int answer,
                    const uint8_t *data, int length, int more) noexcept nogil:
    """Apply a message format. more : bytes of the set before the number of fields"""
    cdef Format *format = &state.now.format[which]
    cdef Format wanted
    cdef int index, count
    if data[0] == READ:
        out[1] = <uint8_t>answer
        if more:
            out[2] = data[1]
        out[2 + more] = <uint8_t>format.count
        for index in range(format.count):
            out[3 + more + 3 * index] = format.descriptor[index]
            put_16(out + 4 + more + 3 * index, format.decimation[index])
        out[0] = <uint8_t>(3 + more + 3 * format.count)
        return out[0]
    if data[0] == SAVE:
        state.saved.format[which] = format[0]
    elif data[0] == LOAD:
        format[0] = state.saved.format[which]
    if data[0] != WRITE:
        return 0
    if length < 2 + more:
        return -3
    count = data[1 + more]
    if count > FIELD_LIMIT or length < 2 + more + 3 * count:
        return -3
    memset(&wanted, 0, sizeof(Format))
    wanted.count = count
    for index in range(count):
        wanted.descriptor[index] = data[2 + more + 3 * index]
        wanted.decimation[index] = <uint16_t>data[3 + more + 3 * index] << 8 | data[4 + more + 3 * index]
        if not supports(arena, at, sizes, 0x82 if which else 0x80,
                wanted.descriptor[index]) or wanted.decimation[index] == 0:
            return -3
    format[0] = wanted
    return 0


cdef void answer(double *arena, const Sensor *at, const Sensor *sizes, State *state,
        const uint8_t *packet) noexcept nogil:
    cdef uint8_t out[400]
    cdef int offset = HEAD
    cdef int end = HEAD + packet[3]
    cdef int count
    while offset < end and packet[offset] >= 2 and offset + packet[offset] <= end:
        memset(out, 0, sizeof(out))
        out[2] = packet[2]
        count = reply(arena, at, sizes, state, out + HEAD + 4, packet[2], packet + offset)
        out[HEAD], out[HEAD + 1], out[HEAD + 2], out[HEAD + 3] = 4, 0xF1, packet[offset + 1], <uint8_t>(-count
            if count < 0 else 0)
        post(arena, at, state, out, finish(out, 4 + max(count, 0)))
        offset += packet[offset]


cdef int sensor_decode(double *arena, const Sensor *at, const Sensor *sizes, const Frame *frame) noexcept nogil:
    cdef State *state = <State *>(arena + at.state)
    cdef int offset = 0
    cdef int need
    start_up(arena, at, sizes, state)
    if frame.id != BYTES or arena[at.disconnected] != 0.0:
        return TAKEN
    memcpy(state.inbox.bytes + state.inbox.length, frame.data, frame.length)
    state.inbox.length += frame.length
    while True:
        need = next_packet(state.inbox.bytes, <int>state.inbox.length, &offset, False, &state.corrupt)
        if need == 0:
            break
        if arena[at.silent] == 0.0:
            answer(arena, at, sizes, state, state.inbox.bytes + offset)
        offset += need
    state.inbox.length -= offset
    memmove(state.inbox.bytes, state.inbox.bytes + offset, state.inbox.length)
    return TAKEN


# Data

cdef void measure(double *arena, const Sensor *at, const Sensor *sizes, const State *state,
        Truth *truth) noexcept nogil:
    """Take the measurements of the present tick."""
    cdef double turned[4]
    memcpy(truth.accel, arena + at.accel, sizeof(truth.accel))
    memcpy(truth.gyro, arena + at.gyro, sizeof(truth.gyro))
    memcpy(truth.mag, arena + at.mag, sizeof(truth.mag))
    memcpy(truth.filter, arena + at.quaternion, sizeof(truth.filter))
    memcpy(truth.sensor, arena + at.quaternion, sizeof(truth.sensor))
    truth.temperature = arena[at.temperature]
    truth.valid = arena[at.uninitialised] == 0.0
    truth.spoilt = arena[at.not_a_number] != 0.0
    if mounting(arena, at, sizes, state, turned):
        mount(truth, turned, (<const Settings *>(arena + at.settings)).newer != 0.0)


cdef void sample(double *arena, const Sensor *at, State *state, Truth *truth, int which,
        double period) noexcept nogil:
    """Send one packet of one set, if due. period : of the base rate"""
    cdef uint8_t packet[400]
    cdef const Format *format = &state.now.format[which]
    cdef int offset = HEAD
    cdef int index, count, bit
    packet[2] = 0x82 if which else 0x80
    for index in range(format.count):
        if state.sample % format.decimation[index] == 0:
            truth.period = period * format.decimation[index]
            count = fill(truth, packet[2], format.descriptor[index], packet + offset + 2)
            if count > 0 and offset + 2 + count <= HEAD + 255:
                packet[offset], packet[offset + 1] = <uint8_t>(2 + count), format.descriptor[index]
                offset += 2 + count
    if offset == HEAD:
        return
    if arena[at.skipped] > 0.0 and chance(state) < arena[at.skipped]:
        return
    count = finish(packet, offset - HEAD)
    if arena[at.flipped] > 0.0 and chance(state) < arena[at.flipped]:
        bit = <int>(chance(state) * 8 * count)
        packet[bit >> 3] ^= <uint8_t>(1 << (bit & 7))
    litter(arena, at, state)
    post(arena, at, state, packet, count)
    arena[at.sent] += 1.0


cdef void litter(double *arena, const Sensor *at, State *state) noexcept nogil:
    """Send random bytes between packets, with a given mean number."""
    cdef uint8_t byte
    cdef double garbage = arena[at.garbage]
    while garbage > 0.0 and chance(state) < garbage / (1.0 + garbage):
        byte = SYNC_1 if chance(state) < 0.05 else SYNC_2 if chance(state) < 0.05 else <uint8_t>(256.0 * chance(state))
        post(arena, at, state, &byte, 1)


cdef void factory(double *arena, const Sensor *at, const Sensor *sizes, Setup *setup) noexcept nogil:
    """Set the factory settings: formats and streams are those of the block."""
    cdef const double *saved = arena + at.power_on
    cdef const double *row
    cdef int which, index, i
    for which in range(2):
        setup.format[which].count = <int>saved[0]
        for index in range(FIELD_LIMIT):
            setup.format[which].descriptor[index] = <uint8_t>saved[1 + 2 * index]
            setup.format[which].decimation[index] = <uint16_t>saved[2 + 2 * index]
        setup.streams[which] = <int>saved[1 + 2 * FIELD_LIMIT]
        saved += 2 + 2 * FIELD_LIMIT
    for index in range(FILTERED):
        setup.low_pass[index].enabled, setup.low_pass[index].manual, setup.low_pass[index].cutoff = 1, 0, 0.0
    for index in range(sizes.registers // WORDS):
        row = arena + at.registers + WORDS * index
        for i in range(<int>row[2]):
            setup.value[index][i] = <uint8_t>row[3 + i]


cdef void start_up(double *arena, const Sensor *at, const Sensor *sizes, State *state) noexcept nogil:
    if state.begun == 0:
        state.begun = 1
        factory(arena, at, sizes, &state.now)
        state.saved = state.now
        state.luck = <uint64_t>(<const Settings *>(arena + at.settings)).seed * 2 + 1
        chance(state)


cdef int sensor_encode(double *arena, const Sensor *at, const Sensor *sizes, Frame *frames) noexcept nogil:
    cdef State *state = <State *>(arena + at.state)
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef double now = arena[TIME]
    cdef double period = 1.0 / settings.base_rate
    cdef int64_t due = <int64_t>(now * settings.base_rate + 1e-6)
    cdef int which, size
    cdef int count = 0
    cdef bint gone = arena[at.disconnected] != 0.0
    cdef Truth truth
    start_up(arena, at, sizes, state)
    memset(frames, 0, FRAMES_PER_DEVICE * sizeof(Frame))
    if gone != (state.gone != 0):
        state.gone = gone
        state.waiting = state.inbox.length = 0
        state.now, state.idle = state.saved, 0
        frames[0].id = LOST if gone else BACK
        count = 1
    if due - state.sample > 100:
        state.sample = due - 100                # not stepped for a long time
    if state.sample <= due:
        measure(arena, at, sizes, state, &truth)
    while state.sample <= due:
        truth.clock = settings.clock_start + state.sample * period / (1.0 + settings.clock_drift)
        if not gone and state.idle == 0 and arena[at.silent] == 0.0:
            for which in range(2):
                if state.now.streams[which]:
                    sample(arena, at, state, &truth, which, period)
        state.sample += 1
    arena[at.streaming] = state.idle == 0 and not gone and (state.now.streams[0] != 0 or state.now.streams[1] != 0)
    while state.waiting > 0 and count < FRAMES_PER_DEVICE:
        size = <int>min(<int64_t>FRAME_BYTES, state.waiting)
        frames[count].length, frames[count].flags = <uint8_t>size, START if count == 0 else 0
        memcpy(frames[count].data, state.outbox, size)
        state.waiting -= size
        memmove(state.outbox, state.outbox + size, state.waiting)
        count += 1
    return count


decode, encode = export_decode(<decode_t>sensor_decode, SENSOR), export_encode(<encode_t>sensor_encode, SENSOR)
state_doubles, register_limit, value_limit = (sizeof(State) + 7) // 8, REGISTERS, VALUE
