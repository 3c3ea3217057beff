# cython: freethreading_compatible=True
"""OpenIMU 300RI and 335RI over SAE J1939: decoding as documented by the vendor.

    acceleration      raw x 0.01 - 320 m/s²
    angular rate      raw / 128 - 250 °/s
    slope             pitch, roll: raw / 32768 - 250 °, three bytes each
    magnetic field    raw / 4000 - 8 G

The 335RI also sends a merit of two bits for each value. It can send these in place of the packets above:

    acceleration      raw / 800 - 320 m/s², 19 bits each, then two bits of merit each
    angular rate      raw / 1024 - 250 °/s, the same
    slope sensor 1    pitch, roll: raw / 500 - 64 °, two bytes each; pitch rate; merit

Firmware of a laboratory may send the temperature in the ambient conditions of J1939 (SAE J1939-71, SPN 171):

    ambient air temperature      raw / 32 - 273 °C, two bytes from byte 4 on

Outputs stay NaN until the unit has confirmed its settings: by default, acceleration and angular rate have different
axes.
"""

from libc.math cimport NAN, M_PI
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    EXTENDED, FOREIGN, ITEMS, MALFORMED, NOTED, TAKEN, Frame, decode_t, encode_t, export_decode, export_encode,
    items,
)
from cext.kernels.devices.openimu.frames cimport (
    ACCELERATION, ADDRESS_CLAIM, AMBIENT, ANGULAR_RATE, BEHAVIOUR, FILTERS, MAGNETIC_FIELD, ORIENTATION, PACKET_RATE,
    PACKET_TYPE,
    FINE_ACCELERATION, FINE_RATE, SENDS_ACCELERATION, SENDS_FIELD, SENDS_FINE_ACCELERATION, SENDS_FINE_RATE,
    SENDS_RATE, SENDS_SLOPE,
    SENDS_SLOPE_1, SLOPE, SLOPE_1, TOLD_BEHAVIOUR, TOLD_FILTERS, TOLD_ORIENTATION, TOLD_RATE, TOLD_TYPE,
    fine, group_of, merit, u16, u24,
)

cdef enum: # in `wanted`
    DIVIDER, TYPES, BITS, MASK, ORIENTED, RATE_FILTER, ACCEL_FILTER, SIGN, NEEDED, GAP, NEWER

cdef enum: # in `state`
    ARRIVED                     # packets since the last complete sample
    STARTED                     # whether any frame was received
    NEXT                        # index of the next frame of `set_up` to send; -1: none
    LAST                        # arrival of the newest packet, s

cdef enum:
    WORDS = 10                  # numbers per frame in `set_up`
    SENT_PER_TICK = 2
    NO_VALUE = 0xFE00           # from here on: "error" and "not available" of J1939

cdef double DEGREE = M_PI / 180.0


cdef struct OpenImu:
    int32_t accel, gyro, mag, roll, pitch, temperature, settings, invalid, address
    int32_t wanted              # the enum above
    int32_t set_up              # identifier, length and eight bytes of each frame that writes or reads settings
    int32_t state               # the enum above

OPEN_IMU = items((<OpenImu *>ITEMS)[0], "accel[3] gyro[3] mag[3] wanted[11] set_up[...] state[4]")


cdef inline void invalid(double *arena, const OpenImu *at, bint is_so) noexcept nogil:
    if is_so:
        arena[at.invalid] += 1.0


cdef int confirm(double *arena, const OpenImu *at, uint32_t group, const Frame *frame) noexcept nogil:
    """Compare a reported setting with the configured one."""
    cdef const double *wanted = arena + at.wanted
    cdef const uint8_t *data = &frame.data[0]
    cdef int bit = 0
    cdef bint agrees = False
    if frame.length < (2 if group == PACKET_RATE else 3):
        return MALFORMED
    if group == PACKET_RATE:
        bit, agrees = TOLD_RATE, data[1] == <uint32_t>wanted[DIVIDER]
    elif group == PACKET_TYPE:
        bit, agrees = TOLD_TYPE, u16(&data[1]) == <uint32_t>wanted[TYPES]
    elif group == BEHAVIOUR:
        bit, agrees = TOLD_BEHAVIOUR, (u16(&data[1]) & <uint32_t>wanted[MASK]) == <uint32_t>wanted[BITS]
    elif group == ORIENTATION:
        bit, agrees = TOLD_ORIENTATION, (<uint32_t>data[1] << 8 | data[2]) == <uint32_t>wanted[ORIENTED]
    else:                       # acceleration first or last, depending on the model
        bit = TOLD_FILTERS
        agrees = ((data[1] == <uint32_t>wanted[ACCEL_FILTER] and data[2] == <uint32_t>wanted[RATE_FILTER])
                  or (data[2] == <uint32_t>wanted[ACCEL_FILTER] and data[1] == <uint32_t>wanted[RATE_FILTER]))
    bit = <int>arena[at.settings] & ~bit | (bit if agrees else 0)
    arena[at.settings] = bit
    return NOTED


cdef void never(double *arena, const OpenImu *at, bint nothing_yet) noexcept nogil:
    """Set outputs without a value to NaN; all outputs until the settings are confirmed."""
    cdef uint32_t types = <uint32_t>arena[at.wanted + TYPES]
    cdef int i
    cdef bint newer = (arena + at.wanted)[NEWER] != 0.0
    if not types & SENDS_SLOPE and not (newer and types & SENDS_SLOPE_1):
        arena[at.roll] = arena[at.pitch] = NAN
    arena[at.temperature] = NAN
    for i in range(3):
        if newer or not types & SENDS_FIELD:
            arena[at.mag + i] = NAN
        if nothing_yet:
            arena[at.accel + i] = arena[at.gyro + i] = NAN


cdef inline void start(double *arena, const OpenImu *at) noexcept nogil:
    """Set the outputs to NaN before the first frame, at the start and again after arming."""
    cdef double *state = arena + at.state
    cdef uint32_t needed = <uint32_t>(arena + at.wanted)[NEEDED]
    if state[STARTED] == 0.0:
        state[STARTED] = 1.0
        never(arena, at, (<uint32_t>arena[at.settings] & needed) != needed)


cdef inline uint32_t packet_of(uint32_t group, bint newer) noexcept nogil:
    """Return the bit in the packet type; 0 for a group that is not a measurement of this model."""
    if group == ACCELERATION:
        return SENDS_ACCELERATION
    if group == ANGULAR_RATE:
        return SENDS_RATE
    if group == SLOPE:
        return SENDS_SLOPE
    if not newer:
        return SENDS_FIELD if group == MAGNETIC_FIELD else 0
    if group == FINE_RATE:
        return SENDS_FINE_RATE
    return SENDS_FINE_ACCELERATION if group == FINE_ACCELERATION else SENDS_SLOPE_1 if group == SLOPE_1 else 0


cdef void take_fine(double *arena, const OpenImu *at, uint32_t packet, const uint8_t *data, double sign) noexcept nogil:
    """Decode a packet of the 335RI only."""
    cdef double *y
    cdef int i
    if packet == SENDS_SLOPE_1:
        arena[at.pitch] = sign * DEGREE * (u16(data) / 500.0 - 64.0)
        arena[at.roll] = DEGREE * (u16(&data[2]) / 500.0 - 64.0)
        for i in range(2):
            invalid(arena, at, merit(data, 48, i) >= 2)
        return
    y = arena + (at.gyro if packet == SENDS_FINE_RATE else at.accel)
    for i in range(3):
        y[i] = DEGREE * (fine(data, i) / 1024.0 - 250.0) if packet == SENDS_FINE_RATE else fine(data, i) / 800.0 - 320.0
        y[i] *= 1.0 if i == 0 else sign
        invalid(arena, at, merit(data, 57, i) >= 2)


cdef int decode_kernel(double *arena, const OpenImu *at, const OpenImu *sizes, const Frame *frame) noexcept nogil:
    cdef const double *wanted = arena + at.wanted
    cdef double *state = arena + at.state
    cdef double *y
    cdef const uint8_t *data = &frame.data[0]
    cdef uint32_t group = group_of(frame.id)
    cdef double sign = wanted[SIGN]
    cdef bint newer = wanted[NEWER] != 0.0                      # a 300RI sends no merit: its bits are 3
    cdef uint32_t needed = <uint32_t>wanted[NEEDED]
    cdef uint32_t packet
    cdef int i
    if group == 0 or (frame.id & 0xFF) != <uint32_t>arena[at.address]:
        return FOREIGN
    if group == ADDRESS_CLAIM:                                  # after power-on the unit has its stored settings
        arena[at.settings] = state[ARRIVED] = state[NEXT] = 0.0
        return NOTED
    if PACKET_RATE <= group <= BEHAVIOUR:
        return confirm(arena, at, group, frame)
    packet = packet_of(group, newer)
    if packet == 0 and group != AMBIENT:
        return NOTED
    if frame.length != 8:
        return MALFORMED
    if group == AMBIENT:
        start(arena, at)
        arena[at.temperature] = NAN if u16(&data[3]) >= NO_VALUE else u16(&data[3]) / 32.0 - 273.0
        return NOTED
    # after a gap: power may have been lost, and the address claim missed
    if state[LAST] > 0.0 and frame.time * 1e-9 - state[LAST] > wanted[GAP]:
        arena[at.settings] = state[ARRIVED] = state[NEXT] = 0.0
    state[LAST] = frame.time * 1e-9
    start(arena, at)
    if (<uint32_t>arena[at.settings] & needed) != needed or not packet & <uint32_t>wanted[TYPES]:
        return NOTED
    state[NEXT] = -1.0
    if newer and packet & (SENDS_FINE_RATE | SENDS_FINE_ACCELERATION | SENDS_SLOPE_1):
        take_fine(arena, at, packet, data, sign)
    elif packet == SENDS_SLOPE:
        arena[at.pitch] = sign * DEGREE * (u24(data) / 32768.0 - 250.0)
        arena[at.roll] = DEGREE * (u24(&data[3]) / 32768.0 - 250.0)
        for i in range(2):                                      # merit of the pitch in bits 50, of the roll in 54
            invalid(arena, at, data[2 + 3 * i] >= NO_VALUE >> 8 or (newer and merit(data, 50, 2 * i) >= 2))
    elif packet == SENDS_RATE:
        y = arena + at.gyro
        for i in range(3):
            y[i] = DEGREE * (u16(&data[2 * i]) / 128.0 - 250.0) * (1.0 if i == 0 else sign)
            invalid(arena, at, u16(&data[2 * i]) >= NO_VALUE or (newer and merit(data, 48, i) >= 2))
    elif packet == SENDS_ACCELERATION:
        y = arena + at.accel
        for i in range(3):
            y[i] = (u16(&data[2 * i]) * 0.01 - 320.0) * (1.0 if i == 0 else sign)
            invalid(arena, at, u16(&data[2 * i]) >= NO_VALUE or (newer and merit(data, 48, i) >= 2))
    else:
        y = arena + at.mag
        for i in range(3):
            y[i] = 100.0 * (u16(&data[2 * i]) / 4000.0 - 8.0) * (1.0 if i == 0 else sign)
    packet |= <uint32_t>state[ARRIVED]
    if (packet & <uint32_t>wanted[TYPES]) != <uint32_t>wanted[TYPES]:
        state[ARRIVED] = packet
        return NOTED
    state[ARRIVED] = 0.0
    return TAKEN                                                # a complete sample


cdef int encode_kernel(double *arena, const OpenImu *at, const OpenImu *sizes, Frame *frames) noexcept nogil:
    """Send the settings to a unit that arming did not wait for, or that has since lost power."""
    cdef double *state = arena + at.state
    cdef const double *kept
    cdef int stored = sizes.set_up // WORDS
    cdef int count, i
    if state[NEXT] < 0.0 or stored == 0:
        return 0
    for count in range(SENT_PER_TICK):
        kept = arena + at.set_up + WORDS * <int>state[NEXT]
        memset(&frames[count], 0, sizeof(Frame))
        frames[count].id = <uint32_t>EXTENDED | <uint32_t>kept[0]
        frames[count].length = <uint8_t>kept[1]
        for i in range(8):
            frames[count].data[i] = <uint8_t>kept[2 + i]
        state[NEXT] = (<int>state[NEXT] + 1) % stored
    return SENT_PER_TICK


decode = export_decode(<decode_t>decode_kernel, OPEN_IMU)
encode = export_encode(<encode_t>encode_kernel, OPEN_IMU)
