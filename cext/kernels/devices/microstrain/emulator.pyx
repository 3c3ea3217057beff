# cython: freethreading_compatible=True
"""Emulated MicroStrain sensor: replies to MIP commands and sends data, with injected faults of sensor and line.

Two generations differ in their commands. The older has a format for each set (0C 08, 0C 0A), streams 1 and 3, and
times since power-on in the fields 80 12 and 82 11; the newer has one format command (0C 0F), streams by their set, and
the shared field D5.
"""

from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memcpy, memmove, memset

from cext.abi cimport (
    FRAMES_PER_DEVICE, FRAME_BYTES, ITEMS, TAKEN, TIME, Frame, decode_t, encode_t, export_decode, export_encode,
    items,
)
from cext.kernels.devices.microstrain.mip cimport (
    HEAD, LOAD, READ, RESET, SAVE, SYNC_1, SYNC_2, WRITE, WRITE_QUIETLY, finish, next_packet, put_16,
    put_32,
)
from cext.kernels.devices.microstrain.settings cimport (
    INFO, OUTBOX, REGISTERS, VALUE, Format, Sensor, Settings, State, factory, low_pass, mounting, poll, set_format,
    setting, supports,
)
from cext.kernels.devices.microstrain.status cimport device_status
from cext.kernels.devices.microstrain.truth cimport Truth, fill, mount
from cext.ring.newest_ring cimport START
from cext.lines.stream_frames cimport BACK, BYTES, LOST

SENSOR = items(
    (<Sensor *>ITEMS)[0],
    "accel[3] gyro[3] mag[3] quaternion[4] about[82] known[...] settings[6] power_on[68] registers[...] state[...]")


cdef inline double chance(State *state) noexcept nogil:
    """Return a uniformly distributed number from 0 to 1: xorshift64*. (Vigna 2016)"""
    state.luck ^= state.luck >> 12
    state.luck ^= state.luck << 25
    state.luck ^= state.luck >> 27
    return <double>((state.luck * <uint64_t>0x2545F4914F6CDD1D) >> 11) * (1.0 / 9007199254740992.0)


cdef void post(double *arena, const Sensor *at, State *state, const uint8_t *data, int count) noexcept nogil:
    """Send bytes on the line, some of which are lost."""
    cdef int index
    cdef double dropped = arena[at.dropped]
    state.written += count
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
    elif command == 0x0172:                         # time of an external clock: 1 week, 2 seconds
        if length < 2 or not 1 <= data[1] <= 2:
            return -3
        if data[0] == READ:
            out[0], out[1] = 6, 0x83 + data[1]
            put_32(out + 2, <uint32_t>(settings.clock_start + arena[TIME]) if data[1] == 2 else 0)
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
    elif command == 0x0C64:
        return device_status(arena, at, sizes, state, out, data, length)
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


cdef void answer(double *arena, const Sensor *at, const Sensor *sizes, State *state,
        const uint8_t *packet) noexcept nogil:
    cdef uint8_t out[400]
    cdef int offset = HEAD
    cdef int end = HEAD + packet[3]
    cdef int count, polled
    cdef bint quiet
    cdef const uint8_t *field
    cdef Format wanted
    while offset < end and packet[offset] >= 2 and offset + packet[offset] <= end:
        field = packet + offset
        memset(out, 0, sizeof(out))
        out[2] = packet[2]
        polled, quiet = polled_set(packet[2], field), False
        if polled == 0:
            count = reply(arena, at, sizes, state, out + HEAD + 4, packet[2], field)
            quiet = packet[2] == 0x01 and field[1] == 0x72 and field[2] == WRITE_QUIETLY
        elif supports(arena, at, sizes, packet[2], field[1]):
            count = field[1] == 0x0D                # bytes before the option
            quiet = field[0] > 2 + count and field[2 + count] != 0
            count = poll(arena, at, sizes, state, &wanted, polled, field + 2 + count, field[0] - 2 - count,
                1 if count else 3)
        else:
            count = -1
        if not quiet:
            out[HEAD], out[HEAD + 1], out[HEAD + 2], out[HEAD + 3] = 4, 0xF1, field[1], <uint8_t>max(-count, 0)
            post(arena, at, state, out, finish(out, 4 + max(count, 0)))
        if polled and count == 0:
            send_polled(arena, at, sizes, state, &wanted, polled)
        offset += field[0]


cdef inline int polled_set(int descriptor_set, const uint8_t *field) noexcept nogil:
    """Return the set of data that a command requests once, 0 for none."""
    if descriptor_set != 0x0C:
        return 0
    if field[1] == 0x0D:
        return field[2] if field[0] > 2 and field[2] == 0x82 else 0x80
    return 0x80 if field[1] == 0x01 else 0x82 if field[1] == 0x03 else 0


cdef void send_polled(double *arena, const Sensor *at, const Sensor *sizes, State *state, const Format *wanted,
        int descriptor_set) noexcept nogil:
    """Send the present measurements, none if no field is known."""
    cdef uint8_t packet[400]
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef Truth truth
    cdef int count
    measure(arena, at, sizes, state, &truth)
    truth.clock = settings.clock_start + arena[TIME] / (1.0 + settings.clock_drift)
    count = pack(&truth, wanted, descriptor_set, 0, 1.0 / settings.base_rate, packet)
    if count:
        post(arena, at, state, packet, finish(packet, count))


cdef int sensor_decode(double *arena, const Sensor *at, const Sensor *sizes, const Frame *frame) noexcept nogil:
    cdef State *state = <State *>(arena + at.state)
    cdef int offset = 0
    cdef int need
    start_up(arena, at, sizes, state)
    if frame.id != BYTES or arena[at.disconnected] != 0.0:
        return TAKEN
    memcpy(state.inbox.bytes + state.inbox.length, frame.data, frame.length)
    state.inbox.length += frame.length
    state.read += frame.length
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


cdef int pack(Truth *truth, const Format *format, int descriptor_set, int64_t number, double period,
        uint8_t *packet) noexcept nogil:
    """Write the fields of a data packet that are due. Returns their length.

    number : number of the sample; period : period of the base rate
    """
    cdef int offset = HEAD
    cdef int index, count
    packet[2] = <uint8_t>descriptor_set
    for index in range(format.count):
        if number % format.decimation[index] == 0:
            truth.period = period * format.decimation[index]
            count = fill(truth, descriptor_set, format.descriptor[index], packet + offset + 2)
            if count > 0 and offset + 2 + count <= HEAD + 255:
                packet[offset], packet[offset + 1] = <uint8_t>(2 + count), format.descriptor[index]
                offset += 2 + count
    return offset - HEAD


cdef void sample(double *arena, const Sensor *at, State *state, Truth *truth, int which,
        double period) noexcept nogil:
    """Send one packet of one set, if due."""
    cdef uint8_t packet[400]
    cdef int bit
    cdef int count = pack(truth, &state.now.format[which], 0x82 if which else 0x80, state.sample, period, packet)
    if count == 0:
        return
    if state.waiting > OUTBOX // 2:                 # a slow line: the rest of it is for replies
        state.lost[which] += 1
        return
    if arena[at.skipped] > 0.0 and chance(state) < arena[at.skipped]:
        return
    count = finish(packet, count)
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
