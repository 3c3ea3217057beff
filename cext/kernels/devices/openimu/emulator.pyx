# cython: freethreading_compatible=True
"""Emulated OpenIMU: accepts settings, replies to requests, and sends data with the rounding of the firmware.

    300RI   (raw + offset) x scale, truncated. By default, y and z of the acceleration are negated, then x and y of
            acceleration and angular rate are swapped; the magnetic field is unchanged
    335RI   the same, rounded in single precision: half a code is added first. It has no magnetometer
"""

from libc.math cimport isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    EXTENDED, FOREIGN, FRAMES_PER_DEVICE, ITEMS, MALFORMED, NOT_FINITE, OK, TAKEN, TIME, Frame, decode_t, encode_t,
    export, export_decode, export_encode, items, kernel_t,
)
from cext.kernels.devices.openimu.frames cimport (
    ACCELERATION, ADDRESS_CLAIM, AMBIENT, ANGULAR_RATE, BEHAVIOUR, FILTERS, FINE_ACCELERATION, FINE_RATE, MAGNETIC_FIELD,
    ORIENTATION, PACKET_RATE, PACKET_TYPE, REQUEST,
    SENDS_ACCELERATION, SENDS_FIELD, SENDS_FINE_ACCELERATION, SENDS_FINE_RATE, SENDS_RATE, SENDS_SLOPE, SENDS_SLOPE_1,
    SLOPE, SLOPE_1, group_of, u16,
)

cdef enum: # in `stored` and `state`
    DIVIDER, TYPES, BITS, ORIENTED, RATE_FILTER, ACCEL_FILTER
    SETTINGS                    # number of settings
    OWED = SETTINGS             # pending replies, one bit each, as in the enum below
    DUE                         # time of the next packets, s
    LUCK                        # random state for dropped frames
    DEAD                        # whether it has no power
    NAME                        # serial number in the NAME of the address claim
    WARM_DUE                    # time of the next temperature, s

cdef enum: # bits of OWED
    OWES_CLAIM = 1
    OWES_RATE = 2
    OWES_TYPE = 4
    OWES_FILTERS = 8
    OWES_ORIENTATION = 16
    OWES_BEHAVIOUR = 32
    OWES_VERSION = 64

cdef enum: # bits of the behaviour
    SWAP_PITCH_ROLL = 0x0008
    ACCEL_NWU = 0x0040
    NEW_REQUEST = 0x0200

cdef enum:
    VERSION = 0xFEDA
    EVERYBODY = 0xFF


cdef struct Unit:
    int32_t accel, gyro, mag, roll, pitch, temperature, silent, dropped, power_lost, address, rounds, sends_temperature
    int32_t stored              # the enum above: settings at power-on
    int32_t state               # the enum above

UNIT = items((<Unit *>ITEMS)[0], "accel[3] gyro[3] mag[3] stored[6] state[12]")


cdef bint drops(double *arena, const Unit *at) noexcept nogil:
    """Return whether the next frame is lost. A linear congruential generator: the same in every run."""
    cdef double *luck = arena + at.state + LUCK
    if not arena[at.dropped] > 0.0:
        return False
    luck[0] = <double>((<uint64_t>luck[0] * 1103515245u + 12345u) & 0x7FFFFFFFu)
    return luck[0] < arena[at.dropped] * 2147483648.0


cdef void asked(double *arena, const Unit *at, const uint8_t *data) noexcept nogil:
    """Handle a request of a parameter group, in the byte order that is set; the 335RI as its stock firmware."""
    cdef double *state = arena + at.state
    cdef bint modern = arena[at.rounds] != 0.0 or <uint32_t>state[BITS] & NEW_REQUEST
    cdef uint32_t group = (u16(data) if modern else <uint32_t>data[1] << 8 | data[2])
    cdef uint32_t owed = (
        OWES_CLAIM if group == ADDRESS_CLAIM else OWES_RATE if group == PACKET_RATE else OWES_TYPE
        if group == PACKET_TYPE
        else OWES_FILTERS if group == FILTERS else OWES_ORIENTATION if group == ORIENTATION else OWES_BEHAVIOUR
        if group == BEHAVIOUR
        else OWES_VERSION if group == VERSION else 0)
    state[OWED] = <double>(<uint32_t>state[OWED] | owed)


cdef int heard_decode(double *arena, const Unit *at, const Unit *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.state
    cdef const uint8_t *data = &frame.data[0]
    cdef uint32_t group = group_of(frame.id)
    cdef uint32_t own = <uint32_t>arena[at.address]
    cdef uint32_t destination = frame.id >> 8 & 0xFF
    if group == REQUEST and (destination == own or destination == EVERYBODY):
        if frame.length != 3:
            return MALFORMED
        if state[DEAD] == 0.0 and not drops(arena, at):
            asked(arena, at, data)
        return TAKEN if destination == own else FOREIGN         # a global request is also addressed to others
    if not PACKET_RATE <= group <= BEHAVIOUR or frame.length < 2 or data[0] != own or (frame.id & 0xFF) == own:
        return FOREIGN
    if frame.length < (2 if group == PACKET_RATE or group == PACKET_TYPE else 3):
        return MALFORMED
    if state[DEAD] != 0.0 or drops(arena, at):
        return TAKEN
    if group == PACKET_RATE:
        state[DIVIDER] = data[1]
    elif group == PACKET_TYPE:
        state[TYPES] = data[1] if frame.length == 2 else u16(&data[1])
    elif group == FILTERS:
        state[RATE_FILTER], state[ACCEL_FILTER] = data[1], data[2]
    elif group == ORIENTATION:
        state[ORIENTED] = <uint32_t>data[1] << 8 | data[2]
    elif arena[at.rounds] == 0.0:
        state[BITS] = u16(&data[1])
    elif frame.length >= 5:                                     # bits to set, bits to clear
        state[BITS] = (<uint32_t>state[BITS] | u16(&data[1])) & ~u16(&data[3])
    return TAKEN


cdef inline void put16(uint8_t *data, double x, bint rounds) noexcept nogil:
    """Write a code in two bytes, clamped to the range of the field."""
    cdef uint32_t code
    if rounds:
        x = <float>(x + 0.5)
    code = 0 if not x > 0.0 else 65535 if x >= 65535.0 else <uint32_t>x
    data[0], data[1] = <uint8_t>code, <uint8_t>(code >> 8)


cdef inline void put24(uint8_t *data, double x, bint rounds) noexcept nogil:
    cdef uint32_t code
    if rounds:
        x = x + 0.5
    code = 0 if not x > 0.0 else 0xFFFFFF if x >= 16777215.0 else <uint32_t>x
    data[0], data[1], data[2] = <uint8_t>code, <uint8_t>(code >> 8), <uint8_t>(code >> 16)


cdef inline void exchange(uint8_t *data) noexcept nogil:
    """Swap x and y."""
    cdef uint8_t[2] kept
    memcpy(kept, data, 2)
    memcpy(data, data + 2, 2)
    memcpy(data + 2, kept, 2)


cdef inline double clamped(double x, double most) noexcept nogil:
    return most if x > most else -most if x < -most else x


cdef void put_fine(double *arena, const Unit *at, uint32_t packet, uint32_t bits, uint8_t *data) noexcept nogil:
    """Write three codes of 19 bits, rounded, in the configured axes."""
    cdef bint turns = packet == SENDS_FINE_RATE
    cdef const double *u = arena + (at.gyro if turns else at.accel)
    cdef uint64_t word = 0
    cdef uint32_t code
    cdef double x
    cdef int i, axis
    for i in range(3):
        axis = 1 - i if i < 2 and bits & SWAP_PITCH_ROLL else i
        if turns:
            x = (clamped(<float>(u[axis] * (180.0 / 3.14159265358979323846)), 250.0) + 250.0) * 1024.0
        else:
            x = ((-u[axis] if axis > 0 and bits & ACCEL_NWU else u[axis]) + 320.0) * 800.0
        x = <float>(x + 0.5)
        code = 0 if not x > 0.0 else 0x7FFFF if x >= 524287.0 else <uint32_t>x
        word |= <uint64_t>code << 19 * i
    memcpy(data, &word, 8)


cdef void measure(double *arena, const Unit *at, uint32_t packet, Frame *frame) noexcept nogil:
    """Write the data of one packet. 57.296 degrees per radian are the firmware's."""
    cdef uint32_t bits = <uint32_t>arena[at.state + BITS]
    cdef bint rounds = arena[at.rounds] != 0.0
    cdef uint8_t *data = &frame.data[0]
    cdef const double *u
    cdef int i
    if packet == SENDS_SLOPE:
        put24(data, (arena[at.pitch] * 57.296 + 250.0) * 32768.0, rounds)
        put24(&data[3], (arena[at.roll] * 57.296 + 250.0) * 32768.0, rounds)
        data[6] = 0x00 if rounds else 0xCC                       # merit: 3 is "not available"
    elif packet == SENDS_RATE:
        u = arena + at.gyro
        for i in range(3):
            put16(&data[2 * i], (clamped(<float>(u[i] * (180.0 / 3.14159265358979323846)), 250.0) + 250.0) * 128.0,
                rounds)
        data[6] = 0x00 if rounds else 0x3F
    elif packet == SENDS_ACCELERATION:
        u = arena + at.accel
        for i in range(3):
            put16(&data[2 * i], ((-u[i] if i > 0 and bits & ACCEL_NWU else u[i]) + 320.0) * 100.0, rounds)
        data[6] = 0x80 if rounds else 0xBF
    elif rounds and packet == SENDS_SLOPE_1:
        put16(data, (clamped(<float>(arena[at.pitch] * 57.296), 64.0) + 64.0) * 500.0, False)
        put16(&data[2], (clamped(<float>(arena[at.roll] * 57.296), 64.0) + 64.0) * 500.0, False)
        put16(&data[4], (clamped(<float>(arena[at.gyro + 1] * 57.296), 64.0) + 64.0) * 500.0, False)
    elif rounds:
        put_fine(arena, at, packet, bits, data)
    else:
        u = arena + at.mag
        for i in range(3):
            put16(&data[2 * i], (0.01 * u[i] + 8.0) / 0.00025, False)
    if bits & SWAP_PITCH_ROLL and (packet == SENDS_RATE or packet == SENDS_ACCELERATION):
        exchange(data)


cdef void answer(double *arena, const Unit *at, uint32_t owed, Frame *frame) noexcept nogil:
    """Write the reply with a setting. The 335RI's begins with the requester's address; its filters are swapped."""
    cdef const double *state = arena + at.state
    cdef bint rounds = arena[at.rounds] != 0.0
    cdef uint8_t *data = &frame.data[0]
    cdef uint32_t value = 0
    cdef uint64_t name
    cdef uint32_t group = (
        PACKET_RATE if owed == OWES_RATE else PACKET_TYPE if owed == OWES_TYPE else FILTERS if owed == OWES_FILTERS
        else ORIENTATION if owed == OWES_ORIENTATION else BEHAVIOUR if owed == OWES_BEHAVIOUR else VERSION
        if owed == OWES_VERSION
        else ADDRESS_CLAIM | EVERYBODY)
    frame.id = <uint32_t>EXTENDED | 6 << 26 | group << 8 | <uint32_t>arena[at.address]
    frame.length = 3
    data[0] = 0xF9 if rounds else <uint8_t>arena[at.address]
    if owed == OWES_CLAIM:                                      # NAME: Aceinna's manufacturer code 823, function 131
        name = <uint64_t>state[NAME] & 0x1FFFFF | <uint64_t>823 << 21 | <uint64_t>131 << 40
        memcpy(data, &name, 8)
        frame.length = 8
    elif owed == OWES_VERSION:
        data[0], data[1], data[2] = 1, 1, 2
        frame.length = 5
    elif owed == OWES_RATE:
        data[1] = <uint8_t>state[DIVIDER]
        frame.length = 2
    elif owed == OWES_TYPE or owed == OWES_BEHAVIOUR:
        value = <uint32_t>state[TYPES if owed == OWES_TYPE else BITS]
        data[1], data[2] = <uint8_t>value, <uint8_t>(value >> 8)
        frame.length = 4 if rounds and owed == OWES_TYPE else 3
    elif owed == OWES_FILTERS:
        data[1] = <uint8_t>state[RATE_FILTER if rounds else ACCEL_FILTER]
        data[2] = <uint8_t>state[ACCEL_FILTER if rounds else RATE_FILTER]
    else:
        value = <uint32_t>state[ORIENTED]
        data[1], data[2] = <uint8_t>(value >> 8), <uint8_t>value


cdef int unit_kernel(double *arena, const Unit *at, const Unit *sizes) noexcept nogil:
    """Handle power: none without it; when restored, load the stored settings and claim the address."""
    cdef double *state = arena + at.state
    if arena[at.power_lost] != 0.0:
        state[DEAD] = 1.0
        state[OWED] = 0.0
    elif state[DEAD] != 0.0:
        memcpy(state, arena + at.stored, SETTINGS * sizeof(double))
        state[DEAD] = 0.0
        state[OWED] = OWES_CLAIM
        state[DUE] = arena[TIME]
    return OK


cdef uint32_t identifier(uint32_t packet, uint32_t address, bint newer) noexcept nogil:
    """Return the identifier of a packet: priority 2 for acceleration, 3 for rate and slope, 6 for the field."""
    if newer and packet & (SENDS_FINE_RATE | SENDS_FINE_ACCELERATION | SENDS_SLOPE_1):
        return <uint32_t>EXTENDED | address | (
            2 << 26 | FINE_ACCELERATION << 8 if packet == SENDS_FINE_ACCELERATION else 3 << 26 | FINE_RATE << 8
            if packet == SENDS_FINE_RATE
            else 3 << 26 | SLOPE_1 << 8)
    return <uint32_t>EXTENDED | address | (
        2 << 26 | ACCELERATION << 8 if packet == SENDS_ACCELERATION else 3 << 26 | ANGULAR_RATE << 8
        if packet == SENDS_RATE
        else 3 << 26 | SLOPE << 8 if packet == SENDS_SLOPE else 6 << 26 | MAGNETIC_FIELD << 8)


cdef inline bint finite(const double *x, int count) noexcept nogil:
    cdef int i
    for i in range(count):
        if not isfinite(x[i]):
            return False
    return True


cdef int send(double *arena, const Unit *at, uint32_t packet, Frame *frames, int count) noexcept nogil:
    """Append a packet to `count` frames if enabled. Returns the new count."""
    if count == FRAMES_PER_DEVICE or not <uint32_t>arena[at.state + TYPES] & packet:
        return count
    if arena[at.silent] != 0.0 or drops(arena, at):
        return count
    memset(&frames[count], 0, sizeof(Frame))
    frames[count].id = identifier(packet, <uint32_t>arena[at.address], arena[at.rounds] != 0.0)
    frames[count].length = 8
    measure(arena, at, packet, &frames[count])
    return count + 1


cdef int send_temperature(double *arena, const Unit *at, Frame *frames, int count) noexcept nogil:
    """Append the ambient conditions to `count` frames once per second, if the firmware sends them."""
    cdef double *state = arena + at.state
    cdef uint8_t *data = &frames[count].data[0]
    if arena[at.sends_temperature] == 0.0 or arena[TIME] < state[WARM_DUE] - 1e-9 or arena[at.silent] != 0.0:
        return count
    state[WARM_DUE] = arena[TIME] + 1.0
    memset(&frames[count], 0, sizeof(Frame))
    memset(data, 0xFF, 8)                                       # not available
    frames[count].id = <uint32_t>EXTENDED | 6 << 26 | AMBIENT << 8 | <uint32_t>arena[at.address]
    frames[count].length = 8
    put16(&data[3], (arena[at.temperature] + 273.0) * 32.0, True)
    return count + 1


cdef int say(double *arena, const Unit *at, uint32_t owed, Frame *frames, int count) noexcept nogil:
    """Append a reply to `count` frames if pending. Returns the new count."""
    cdef double *state = arena + at.state
    if not <uint32_t>state[OWED] & owed:
        return count
    state[OWED] = <double>(<uint32_t>state[OWED] & ~owed)
    if arena[at.silent] != 0.0 or drops(arena, at):
        return count
    memset(&frames[count], 0, sizeof(Frame))
    answer(arena, at, owed, &frames[count])
    return count + 1


cdef int send_encode(double *arena, const Unit *at, const Unit *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + at.state
    cdef uint32_t bit = 1
    cdef int count = 0
    if not (finite(arena + at.accel, 3) and finite(arena + at.gyro, 3) and finite(arena + at.mag, 3)
            and finite(arena + at.roll, 1) and finite(arena + at.pitch, 1) and finite(arena + at.temperature, 1)):
        return -NOT_FINITE
    if state[DEAD] != 0.0:
        return 0
    if <uint32_t>state[OWED] & OWES_CLAIM:                      # before any other frame
        count = say(arena, at, OWES_CLAIM, frames, count)
    elif state[DIVIDER] > 0.0 and arena[TIME] >= state[DUE] - 1e-9:
        state[DUE] += 0.01 * state[DIVIDER]
        if state[DUE] < arena[TIME]:
            state[DUE] = arena[TIME] + 0.01 * state[DIVIDER]
        count = send(arena, at, SENDS_SLOPE, frames, count)
        count = send(arena, at, SENDS_ACCELERATION, frames, count)
        if arena[at.rounds] == 0.0:
            count = send(arena, at, SENDS_FIELD, frames, count)
        count = send(arena, at, SENDS_RATE, frames, count)
        if arena[at.rounds] != 0.0:
            count = send(arena, at, SENDS_SLOPE_1, frames, count)
            count = send(arena, at, SENDS_FINE_ACCELERATION, frames, count)
            count = send(arena, at, SENDS_FINE_RATE, frames, count)
    if count < FRAMES_PER_DEVICE:
        count = send_temperature(arena, at, frames, count)
    while bit <= OWES_VERSION and count < FRAMES_PER_DEVICE:
        count = say(arena, at, bit, frames, count)
        bit <<= 1
    return count


unit = export(<kernel_t>unit_kernel, UNIT)
unit_decode = export_decode(<decode_t>heard_decode, UNIT)
unit_encode = export_encode(<encode_t>send_encode, UNIT)
