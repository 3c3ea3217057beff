"""Settings of an emulated MicroStrain sensor: formats, streams, low-pass, and those that it only stores.

A command of a setting begins with a function: write, read, save, load, or reset to the factory value. The functions here
return the length of the reply's fields after the acknowledgement, or the negated error code.
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint16_t, uint64_t
from libc.string cimport memcpy, memset

from cext.kernels.devices.microstrain.mip cimport (
    LOAD, READ, RESET, SAVE, WRITE, Pending, float_32, from_angles, put_16, put_float,
)

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
    double number               # number of the model

cdef struct Format:
    int32_t count
    uint8_t descriptor[FIELD_LIMIT]
    uint16_t decimation[FIELD_LIMIT]

cdef struct LowPass:
    int32_t enabled
    int32_t manual              # 0: the cutoff is half the rate of the field
    float cutoff                # Hz, if manual

cdef struct Setup:              # settings that can be saved
    Format format[2]            # formats of the sets 80 and 82
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
    int64_t read                # bytes
    int64_t written
    int64_t lost[2]             # packets of the sets 80 and 82, on a slow line

cdef struct Sensor:
    int32_t accel, gyro, mag, quaternion, temperature, silent, garbage, dropped, flipped, skipped, not_a_number
    int32_t uninitialised, disconnected, streaming, heading, cutoff, sent
    int32_t about               # bytes of the reply to device info
    int32_t known               # commands and fields, set << 8 | descriptor
    int32_t settings            # Settings
    int32_t power_on            # formats, and whether it streams
    int32_t registers           # further settings, which have no effect except the rotation
    int32_t state               # State


cdef inline int poll(double *arena, const Sensor *at, const Sensor *sizes, const State *state, Format *wanted,
        int descriptor_set, const uint8_t *data, int length, int size) noexcept nogil:
    """Find the fields that a request names, or those of the stored format. Returns 0 or the negated error code.

    data : data of the command, from its option; size : bytes of each descriptor
    """
    cdef int index, count
    if length < 2 or length < 2 + size * data[1]:
        return -3
    wanted[0] = state.now.format[descriptor_set >> 1 & 1]
    count = data[1]
    if count:
        wanted.count = 0
    for index in range(count):                      # unknown ones are ignored
        if wanted.count < FIELD_LIMIT and supports(arena, at, sizes, descriptor_set, data[2 + size * index]):
            wanted.descriptor[wanted.count], wanted.decimation[wanted.count] = data[2 + size * index], 1
            wanted.count += 1
    return 0 if count or wanted.count else -4


cdef inline bint supports(double *arena, const Sensor *at, const Sensor *sizes, int descriptor_set,
        int descriptor) noexcept nogil:
    cdef double *known = arena + at.known
    cdef int count = sizes.known
    cdef int index
    for index in range(count):
        if known[index] == descriptor_set << 8 | descriptor:
            return True
    return False


cdef inline int setting(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, int command,
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


cdef inline int register_of(double *arena, const Sensor *at, const Sensor *sizes, int command) noexcept nogil:
    """Return the index of a command's setting, -1 for none."""
    cdef int index
    for index in range(sizes.registers // WORDS):
        if <int>arena[at.registers + WORDS * index] == command:
            return index
    return -1


cdef inline bint is_valid(int command, const uint8_t *data, bint has_magnetometer) noexcept nogil:
    cdef int i
    if command == 0x0C51:                           # up and north: enabled, 1 to 1000 s
        return (data[0] <= 1 and data[1] <= 1 and (data[1] == 0 or has_magnetometer)
            and 1.0 <= float_32(data + 2) <= 1000.0 and 1.0 <= float_32(data + 6) <= 1000.0)
    if command == 0x0D11 or command == 0x0C31:      # roll, pitch, yaw
        for i in range(3):
            if not isfinite(float_32(data + 4 * i)):
                return False
    return True


cdef inline bint mounting(double *arena, const Sensor *at, const Sensor *sizes, const State *state, double *q) noexcept nogil:
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


cdef inline int low_pass(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, bint newer,
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


cdef inline int set_format(double *arena, const Sensor *at, const Sensor *sizes, State *state, uint8_t *out, int which,
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


cdef inline void factory(double *arena, const Sensor *at, const Sensor *sizes, Setup *setup) noexcept nogil:
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
