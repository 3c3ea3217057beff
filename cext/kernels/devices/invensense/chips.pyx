# cython: freethreading_compatible=True
"""InvenSense IMUs with an AKM magnetometer on their auxiliary bus: decoding of their registers.

    MPU-9250, 9255   transfer 0, 14 bytes from 0x3B: accel, temperature, gyro, int16 each, most significant byte first
                     transfer 1, 8 bytes from 0x02 of the AK8963 and its adjustment: ST1, x, y, z least significant byte
                     first, ST2, ASA
                     transfer 2, if the IMU reads its magnetometer itself: 22 bytes from 0x3B, both in sequence
    ICM-20948        transfer 0, 14 bytes from 0x2D: accel, gyro, temperature, as above
                     transfer 1, 9 bytes from 0x10 of the AK09916: ST1, x, y, z least significant byte first, one byte,
                     ST2

ST1 bit 0: new measurement. ST2 bit 3: overflow, the field was too strong. AK8963 ST2 bit 4: codes of 16 bits, as
configured; without it the chip has lost its settings.
(PS-MPU-9250A-01 1.1, RM-MPU-9250A-00 1.6, AK8963 MS1356-E-02, DS-000189 1.5)
"""

from libc.math cimport fabs, isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t
from libc.string cimport memcmp, memcpy, memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOTED, NOT_FINITE, TAKEN, TIME, Frame, decode_t, encode_t, export_decode,
    export_encode, items,
)
from cext.conversion cimport to_u32
from cext.lines.i2c_answers cimport TROUBLE, answer_id, big, code_of, failures, little, put_big, put_little, transfer_of

cdef enum: # in `state` of an emulated chip
    NEXT                        # s, of both transfers
    HELD = 2                    # whether it is stuck
    HELD_BURST = 3              # 14 bytes repeated while stuck
    HELD_FIELD = 5              # 8 bytes repeated while stuck

cdef enum:
    READY = 0x01                # ST1
    OVERFLOW = 0x08             # ST2
    WIDE = 0x10                 # ST2 of the AK8963
    BURST = 14                  # bytes
    FIELD = 11                  # bytes of an AK8963, with its adjustment

cdef double DEGREES_PER_CODE = 1.0 / 333.87
cdef double ROOM_TEMPERATURE = 21.0
cdef double STRONGEST = 4912.0  # µT, range of the magnetometers as the sum of the absolute values of the three axes


cdef inline void mapped(const double *map, const double *x, double *y) noexcept nogil:
    """Compute y = M (x - b)."""
    cdef int row
    for row in range(3):
        y[row] = map[3 * row] * (x[0] - map[9]) + map[3 * row + 1] * (x[1] - map[10]) + map[3 * row + 2] * (x[2]
            - map[11])


cdef struct Chip:
    int32_t accel, gyro, mag, temperature, mag_age, mag_overflow, repeated, errors
    int32_t identity            # place << 8 | address
    int32_t scales              # m/s², rad/s, µT per code
    int32_t accel_map           # matrix of three rows, and the offset
    int32_t gyro_bias           # rad/s
    int32_t mag_map             # matrix of three rows, and the offset
    int32_t seen                # newest 14 bytes; whether there were any; time of the newest magnetometer sample, s

CHIP = items((<Chip *>ITEMS)[0], "accel[3] gyro[3] mag[3] scales[3] accel_map[12] gyro_bias[3] mag_map[12] seen[4]")


cdef void take_burst(double *arena, const Chip *at, const Frame *frame, int gyro, int temperature) noexcept nogil:
    """Decode a burst that begins with the acceleration. The other values start at the given bytes."""
    cdef double *scales = arena + at.scales
    cdef double *seen = arena + at.seen
    cdef double *bias = arena + at.gyro_bias
    cdef double raw[3]
    cdef int axis
    cdef bint again = seen[2] != 0.0 and memcmp(seen, frame.data, BURST) == 0
    arena[at.repeated] = arena[at.repeated] + 1.0 if again else 0.0
    memcpy(seen, frame.data, BURST)
    seen[2] = 1.0
    for axis in range(3):
        raw[axis] = scales[0] * big(&frame.data[2 * axis])
        (arena + at.gyro)[axis] = scales[1] * big(&frame.data[gyro + 2 * axis]) - bias[axis]
    mapped(arena + at.accel_map, raw, arena + at.accel)
    arena[at.temperature] = DEGREES_PER_CODE * big(&frame.data[temperature]) + ROOM_TEMPERATURE
    arena[at.mag_age] = max(1e-9 * frame.time - seen[3], 0.0)


cdef int take_field(double *arena, const Chip *at, const Frame *frame, const double *field,
        bint overflow) noexcept nogil:
    """Write a new measurement of the magnetometer, µT along the accelerometer's axes; an overflow keeps the old one."""
    arena[at.mag_overflow] = overflow
    if not overflow:
        mapped(arena + at.mag_map, field, arena + at.mag)
        (arena + at.seen)[3] = 1e-9 * frame.time
    return NOTED


cdef int take_trouble(double *arena, const Chip *at, const Frame *frame) noexcept nogil:
    if frame.length != 5:
        return MALFORMED
    arena[at.errors] = failures(frame)
    return NOTED


cdef int take_ak8963(double *arena, const Chip *at, const Frame *frame, const uint8_t *data) noexcept nogil:
    """Decode the eight bytes of the AK8963 and its adjustment."""
    cdef double field[3]
    cdef double own[3]
    cdef int axis
    if not data[7] & WIDE:
        return MALFORMED
    if not data[0] & READY:
        return NOTED
    for axis in range(3):
        own[axis] = (arena + at.scales)[2] * little(&data[1 + 2 * axis]) * ((data[8 + axis] - 128) / 256.0 + 1.0)
    field[0], field[1], field[2] = own[1], own[0], -own[2]
    return take_field(arena, at, frame, field, data[7] & OVERFLOW != 0)


cdef int mpu_decode_(double *arena, const Chip *at, const Chip *sizes, const Frame *frame) noexcept nogil:
    cdef int transfer = transfer_of(frame, <uint32_t>arena[at.identity])
    if transfer == 0:
        if frame.length != BURST:
            return MALFORMED
        take_burst(arena, at, frame, 8, 6)
        return TAKEN
    if transfer == TROUBLE:
        return take_trouble(arena, at, frame)
    if transfer == 1:
        return take_ak8963(arena, at, frame, frame.data) if frame.length == FIELD else MALFORMED
    if transfer != 2:
        return FOREIGN
    if frame.length != BURST + FIELD:
        return MALFORMED
    take_ak8963(arena, at, frame, &frame.data[BURST])
    take_burst(arena, at, frame, 8, 6)
    return TAKEN


cdef int icm_decode_(double *arena, const Chip *at, const Chip *sizes, const Frame *frame) noexcept nogil:
    cdef int transfer = transfer_of(frame, <uint32_t>arena[at.identity])
    cdef double scale = (arena + at.scales)[2]
    cdef double field[3]
    if transfer == 0:
        if frame.length != BURST:
            return MALFORMED
        take_burst(arena, at, frame, 6, 12)
        return TAKEN
    if transfer == TROUBLE:
        return take_trouble(arena, at, frame)
    if transfer != 1:
        return FOREIGN
    if frame.length != 9:
        return MALFORMED
    if not frame.data[0] & READY:
        return NOTED
    field[0] = scale * little(&frame.data[1])
    field[1] = -scale * little(&frame.data[3])
    field[2] = -scale * little(&frame.data[5])
    return take_field(arena, at, frame, field, frame.data[8] & OVERFLOW != 0)


# Emulated sensors

cdef inline bint is_finite(const double *x) noexcept nogil:
    return isfinite(x[0]) and isfinite(x[1]) and isfinite(x[2])


cdef struct Emulated:
    int32_t accel, gyro, mag, temperature, silent, stuck, wrong_address, mag_overflow, mag_not_ready, identity
    int32_t scales
    int32_t periods             # s between transfers of each kind, 0 for never; whether they are combined
    int32_t fuses               # the three bytes of ASA
    int32_t state               # the enum above

EMULATED = items((<Emulated *>ITEMS)[0], "accel[3] gyro[3] mag[3] scales[3] periods[3] fuses[3] state[7]")


cdef inline bint due(double *arena, const Emulated *at, int transfer) noexcept nogil:
    """Return whether a transfer is due; the next one is then due a period later."""
    cdef double period = (arena + at.periods)[transfer]
    cdef double *next = arena + at.state + NEXT + transfer
    if period <= 0.0 or arena[TIME] + 1e-9 < next[0]:
        return False
    next[0] = max(next[0] + period, arena[TIME] + 1e-9)
    return True


cdef inline Frame *fresh(double *arena, const Emulated *at, Frame *frame, int transfer, int length) noexcept nogil:
    cdef uint32_t identity = <uint32_t>arena[at.identity]
    if arena[at.wrong_address] > 0.0:
        identity = (identity & ~<uint32_t>0xFF) | (to_u32(arena[at.wrong_address]) & 0x7F)
    memset(frame, 0, sizeof(Frame))
    frame.id = answer_id(identity, transfer)
    frame.length = <uint8_t>length
    return frame


cdef void write_burst(double *arena, const Emulated *at, uint8_t *data, int gyro, int temperature) noexcept nogil:
    cdef double *scales = arena + at.scales
    cdef int axis
    for axis in range(3):
        put_big(&data[2 * axis], code_of((arena + at.accel)[axis], scales[0]))
        put_big(&data[gyro + 2 * axis], code_of((arena + at.gyro)[axis], scales[1]))
    put_big(&data[temperature], code_of(arena[at.temperature] - ROOM_TEMPERATURE, DEGREES_PER_CODE))


cdef void write_field(double *arena, const Emulated *at, const double *field, uint8_t *data, int second) noexcept nogil:
    """Write ST1, the magnetometer's axes in its own order, and ST2 at an index. field : µT"""
    cdef double sum = fabs((arena + at.mag)[0]) + fabs((arena + at.mag)[1]) + fabs((arena + at.mag)[2])
    cdef int axis
    data[0] = 0 if arena[at.mag_not_ready] != 0.0 else READY
    for axis in range(3):
        put_little(&data[1 + 2 * axis], code_of(field[axis], (arena + at.scales)[2]))
    if arena[at.mag_overflow] != 0.0 or sum > STRONGEST:
        data[second] |= OVERFLOW


cdef void hold(double *arena, const Emulated *at, uint8_t *data, int length, int place) noexcept nogil:
    """Keep or repeat the bytes of a transfer; a stuck sensor repeats its first ones."""
    cdef double *state = arena + at.state
    cdef int known = 1 if place == HELD_BURST else 2
    if arena[at.stuck] == 0.0:
        state[HELD] = 0.0
    elif <int>state[HELD] & known:
        memcpy(data, &state[place], length)
    else:
        state[HELD] = <double>(<int>state[HELD] | known)
        memcpy(&state[place], data, length)


cdef inline bint sayable(double *arena, const Emulated *at) noexcept nogil:
    """Return whether all inputs are finite; a diverged plant gets no reply."""
    return (is_finite(arena + at.accel) and is_finite(arena + at.gyro) and is_finite(arena + at.mag)
            and isfinite(arena[at.temperature]))


cdef void write_ak8963(double *arena, const Emulated *at, uint8_t *data) noexcept nogil:
    cdef double *field = arena + at.mag
    cdef double *adjustment = arena + at.fuses
    cdef double own[3]
    cdef int axis
    own[0], own[1], own[2] = field[1], field[0], -field[2]
    for axis in range(3):
        own[axis] /= (adjustment[axis] - 128.0) / 256.0 + 1.0
        data[8 + axis] = <uint8_t>adjustment[axis]
    data[7] = WIDE
    write_field(arena, at, own, data, 7)
    hold(arena, at, data, 8, HELD_FIELD)


cdef int mpu_answers_(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef bint together = (arena + at.periods)[2] != 0.0
    cdef int count = 0
    cdef uint8_t *data
    if not sayable(arena, at):
        return -NOT_FINITE
    if due(arena, at, 0):
        data = fresh(arena, at, &frames[count], 2 if together else 0, BURST + FIELD if together else BURST).data
        write_burst(arena, at, data, 8, 6)
        hold(arena, at, data, BURST, HELD_BURST)
        if together:
            write_ak8963(arena, at, &data[BURST])
            if not due(arena, at, 1):
                data[BURST] = 0                 # measurement already read
        count += 1
    if not together and due(arena, at, 1):
        write_ak8963(arena, at, fresh(arena, at, &frames[count], 1, FIELD).data)
        count += 1
    return 0 if arena[at.silent] != 0.0 else count


cdef int icm_answers_(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef double *field = arena + at.mag
    cdef double own[3]
    cdef int count = 0
    cdef uint8_t *data
    if not sayable(arena, at):
        return -NOT_FINITE
    if due(arena, at, 0):
        data = fresh(arena, at, &frames[count], 0, BURST).data
        write_burst(arena, at, data, 6, 12)
        hold(arena, at, data, BURST, HELD_BURST)
        count += 1
    if due(arena, at, 1):
        data = fresh(arena, at, &frames[count], 1, 9).data
        own[0], own[1], own[2] = field[0], -field[1], -field[2]
        write_field(arena, at, own, data, 8)
        hold(arena, at, data, 9, HELD_FIELD)
        count += 1
    return 0 if arena[at.silent] != 0.0 else count


mpu_decode = export_decode(<decode_t>mpu_decode_, CHIP)
icm_decode = export_decode(<decode_t>icm_decode_, CHIP)
mpu_answers = export_encode(<encode_t>mpu_answers_, EMULATED)
icm_answers = export_encode(<encode_t>icm_answers_, EMULATED)
