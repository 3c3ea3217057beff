# cython: freethreading_compatible=True
"""IMUs of InvenSense with a magnetometer of AKM behind their bypass: what their registers say.

    MPU-9250, 9255   transfer 0, 14 bytes from 0x3B: accel, temperature, gyro, int16 each, most significant byte first
                     transfer 1, 8 bytes from 0x02 of the AK8963 and its adjustment: ST1, x, y, z least significant byte first, ST2, ASA
                     transfer 2, where it reads its magnetometer itself: 22 bytes from 0x3B, the same two one after the other
    ICM-20948        transfer 0, 14 bytes from 0x2D: accel, gyro, temperature, as above
                     transfer 1, 9 bytes from 0x10 of the AK09916: ST1, x, y, z least significant byte first, one byte, ST2

ST1 bit 0: this is a new measurement. ST2 bit 3: it is none, as the field was too strong. AK8963 ST2 bit 4: codes of 16 bits, as it was
set up; without it the chip has lost its settings. (PS-MPU-9250A-01 1.1, RM-MPU-9250A-00 1.6, AK8963 MS1356-E-02, DS-000189 1.5.)
"""

from libc.math cimport fabs, isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t
from libc.string cimport memcmp, memcpy, memset

from cext.abi cimport FOREIGN, MALFORMED, NOTED, NOT_FINITE, TAKEN, TIME, Frame, export_decode, export_encode
from cext.lines.i2c_answers cimport TROUBLE, answer_id, big, code_of, failures, little, put_big, put_little, transfer_of

cdef enum: # of the driver: outputs, memory
    ACCEL, GYRO, MAG, TEMPERATURE, AGE, MAG_AGE, MAG_OVERFLOW, REPEATED, ERRORS
    IDENTITY                    # place << 8 | address
    SCALES                      # m/s², rad/s, µT of a code
    ACCEL_MAP                   # matrix of three rows, and what is taken away before
    GYRO_BIAS                   # rad/s
    MAG_MAP                     # as that of accel
    SEEN                        # the newest 14 bytes, whether there were any, s at which the magnetometer measured

cdef enum: # of the emulator: inputs, memory
    TRUE_ACCEL, TRUE_GYRO, TRUE_MAG, TRUE_TEMPERATURE, SILENT, STUCK, WRONG_ADDRESS, OVERFLOWS, NOT_READY
    OWN_IDENTITY
    OWN_SCALES
    PERIODS                     # s between transfers of each kind, 0 for never; whether they are one
    ADJUSTMENT                  # the three bytes of ASA
    STATE                       # as the enum below

cdef enum: # in STATE
    NEXT                        # s, of both transfers
    HELD = 2                    # whether it is stuck,
    HELD_BURST = 3              # with these 14
    HELD_FIELD = 5              # and 8 bytes

cdef enum:
    READY = 0x01                # ST1
    OVERFLOW = 0x08             # ST2
    WIDE = 0x10                 # ST2 of the AK8963
    BURST = 14                  # bytes
    FIELD = 11                  # of an AK8963, with its adjustment

cdef double DEGREES_PER_CODE = 1.0 / 333.87
cdef double ROOM_TEMPERATURE = 21.0
cdef double STRONGEST = 4912.0  # µT that the magnetometers measure, as a sum of the three axes without sign


cdef inline void mapped(const double *map, const double *x, double *y) noexcept nogil:
    """y = M (x - b)"""
    cdef int row
    for row in range(3):
        y[row] = map[3 * row] * (x[0] - map[9]) + map[3 * row + 1] * (x[1] - map[10]) + map[3 * row + 2] * (x[2] - map[11])


cdef void take_burst(double *arena, const int32_t *slots, const Frame *frame, int gyro, int temperature) noexcept nogil:
    """A burst whose acceleration comes first; the others from these bytes on."""
    cdef double *scales = arena + slots[SCALES]
    cdef double *seen = arena + slots[SEEN]
    cdef double *bias = arena + slots[GYRO_BIAS]
    cdef double raw[3]
    cdef int axis
    cdef bint again = seen[2] != 0.0 and memcmp(seen, frame.data, BURST) == 0
    arena[slots[REPEATED]] = arena[slots[REPEATED]] + 1.0 if again else 0.0
    memcpy(seen, frame.data, BURST)
    seen[2] = 1.0
    for axis in range(3):
        raw[axis] = scales[0] * big(&frame.data[2 * axis])
        (arena + slots[GYRO])[axis] = scales[1] * big(&frame.data[gyro + 2 * axis]) - bias[axis]
    mapped(arena + slots[ACCEL_MAP], raw, arena + slots[ACCEL])
    arena[slots[TEMPERATURE]] = DEGREES_PER_CODE * big(&frame.data[temperature]) + ROOM_TEMPERATURE
    arena[slots[MAG_AGE]] = max(1e-9 * frame.time - seen[3], 0.0)


cdef int take_field(double *arena, const int32_t *slots, const Frame *frame, const double *field, bint overflow) noexcept nogil:
    """A new measurement of the magnetometer, µT along the axes of the accelerometer. One that overflowed keeps what was there."""
    arena[slots[MAG_OVERFLOW]] = overflow
    if not overflow:
        mapped(arena + slots[MAG_MAP], field, arena + slots[MAG])
        (arena + slots[SEEN])[3] = 1e-9 * frame.time
    return NOTED


cdef int take_trouble(double *arena, const int32_t *slots, const Frame *frame) noexcept nogil:
    if frame.length != 5:
        return MALFORMED
    arena[slots[ERRORS]] = failures(frame)
    return NOTED


cdef int take_ak8963(double *arena, const int32_t *slots, const Frame *frame, const uint8_t *data) noexcept nogil:
    """Its eight bytes and its adjustment."""
    cdef double field[3]
    cdef double own[3]
    cdef int axis
    if not data[7] & WIDE:
        return MALFORMED
    if not data[0] & READY:
        return NOTED
    for axis in range(3):
        own[axis] = (arena + slots[SCALES])[2] * little(&data[1 + 2 * axis]) * ((data[8 + axis] - 128) / 256.0 + 1.0)
    field[0], field[1], field[2] = own[1], own[0], -own[2]
    return take_field(arena, slots, frame, field, data[7] & OVERFLOW != 0)


cdef int mpu_decode_(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int transfer = transfer_of(frame, <uint32_t>arena[slots[IDENTITY]])
    if transfer == 0:
        if frame.length != BURST:
            return MALFORMED
        take_burst(arena, slots, frame, 8, 6)
        return TAKEN
    if transfer == TROUBLE:
        return take_trouble(arena, slots, frame)
    if transfer == 1:
        return take_ak8963(arena, slots, frame, frame.data) if frame.length == FIELD else MALFORMED
    if transfer != 2:
        return FOREIGN
    if frame.length != BURST + FIELD:
        return MALFORMED
    take_ak8963(arena, slots, frame, &frame.data[BURST])
    take_burst(arena, slots, frame, 8, 6)
    return TAKEN


cdef int icm_decode_(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int transfer = transfer_of(frame, <uint32_t>arena[slots[IDENTITY]])
    cdef double scale = (arena + slots[SCALES])[2]
    cdef double field[3]
    if transfer == 0:
        if frame.length != BURST:
            return MALFORMED
        take_burst(arena, slots, frame, 6, 12)
        return TAKEN
    if transfer == TROUBLE:
        return take_trouble(arena, slots, frame)
    if transfer != 1:
        return FOREIGN
    if frame.length != 9:
        return MALFORMED
    if not frame.data[0] & READY:
        return NOTED
    field[0] = scale * little(&frame.data[1])
    field[1] = -scale * little(&frame.data[3])
    field[2] = -scale * little(&frame.data[5])
    return take_field(arena, slots, frame, field, frame.data[8] & OVERFLOW != 0)


# The sensors that are not there

cdef inline bint is_finite(const double *x) noexcept nogil:
    return isfinite(x[0]) and isfinite(x[1]) and isfinite(x[2])


cdef inline bint due(double *arena, const int32_t *slots, int transfer) noexcept nogil:
    """Whether a transfer is due; then the next one is due a period later."""
    cdef double period = (arena + slots[PERIODS])[transfer]
    cdef double *next = arena + slots[STATE] + NEXT + transfer
    if period <= 0.0 or arena[TIME] + 1e-9 < next[0]:
        return False
    next[0] = max(next[0] + period, arena[TIME] + 1e-9)
    return True


cdef inline Frame *fresh(double *arena, const int32_t *slots, Frame *frame, int transfer, int length) noexcept nogil:
    cdef uint32_t identity = <uint32_t>arena[slots[OWN_IDENTITY]]
    if arena[slots[WRONG_ADDRESS]] > 0.0:
        identity = (identity & ~<uint32_t>0xFF) | (<uint32_t>arena[slots[WRONG_ADDRESS]] & 0x7F)
    memset(frame, 0, sizeof(Frame))
    frame.id = answer_id(identity, transfer)
    frame.length = <uint8_t>length
    return frame


cdef void write_burst(double *arena, const int32_t *slots, uint8_t *data, int gyro, int temperature) noexcept nogil:
    cdef double *scales = arena + slots[OWN_SCALES]
    cdef int axis
    for axis in range(3):
        put_big(&data[2 * axis], code_of((arena + slots[TRUE_ACCEL])[axis], scales[0]))
        put_big(&data[gyro + 2 * axis], code_of((arena + slots[TRUE_GYRO])[axis], scales[1]))
    put_big(&data[temperature], code_of(arena[slots[TRUE_TEMPERATURE]] - ROOM_TEMPERATURE, DEGREES_PER_CODE))


cdef void write_field(double *arena, const int32_t *slots, const double *field, uint8_t *data, int second) noexcept nogil:
    """ST1, the three axes of the magnetometer, as it has them, and ST2 at that byte. field : µT"""
    cdef double sum = fabs((arena + slots[TRUE_MAG])[0]) + fabs((arena + slots[TRUE_MAG])[1]) + fabs((arena + slots[TRUE_MAG])[2])
    cdef int axis
    data[0] = 0 if arena[slots[NOT_READY]] != 0.0 else READY
    for axis in range(3):
        put_little(&data[1 + 2 * axis], code_of(field[axis], (arena + slots[OWN_SCALES])[2]))
    if arena[slots[OVERFLOWS]] != 0.0 or sum > STRONGEST:
        data[second] |= OVERFLOW


cdef void hold(double *arena, const int32_t *slots, uint8_t *data, int length, int place) noexcept nogil:
    """A sensor that is stuck goes on with what it said first."""
    cdef double *state = arena + slots[STATE]
    cdef int known = 1 if place == HELD_BURST else 2
    if arena[slots[STUCK]] == 0.0:
        state[HELD] = 0.0
    elif <int>state[HELD] & known:
        memcpy(data, &state[place], length)
    else:
        state[HELD] = <double>(<int>state[HELD] | known)
        memcpy(&state[place], data, length)


cdef inline bint sayable(double *arena, const int32_t *slots) noexcept nogil:
    """A plant that has blown up has no answer."""
    return (is_finite(arena + slots[TRUE_ACCEL]) and is_finite(arena + slots[TRUE_GYRO]) and is_finite(arena + slots[TRUE_MAG])
            and isfinite(arena[slots[TRUE_TEMPERATURE]]))


cdef void write_ak8963(double *arena, const int32_t *slots, uint8_t *data) noexcept nogil:
    cdef double *field = arena + slots[TRUE_MAG]
    cdef double *adjustment = arena + slots[ADJUSTMENT]
    cdef double own[3]
    cdef int axis
    own[0], own[1], own[2] = field[1], field[0], -field[2]
    for axis in range(3):
        own[axis] /= (adjustment[axis] - 128.0) / 256.0 + 1.0
        data[8 + axis] = <uint8_t>adjustment[axis]
    data[7] = WIDE
    write_field(arena, slots, own, data, 7)
    hold(arena, slots, data, 8, HELD_FIELD)


cdef int mpu_answers_(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef bint together = (arena + slots[PERIODS])[2] != 0.0
    cdef int count = 0
    cdef uint8_t *data
    if not sayable(arena, slots):
        return -NOT_FINITE
    if due(arena, slots, 0):
        data = fresh(arena, slots, &frames[count], 2 if together else 0, BURST + FIELD if together else BURST).data
        write_burst(arena, slots, data, 8, 6)
        hold(arena, slots, data, BURST, HELD_BURST)
        if together:
            write_ak8963(arena, slots, &data[BURST])
            if not due(arena, slots, 1):
                data[BURST] = 0                 # it has read the same measurement before
        count += 1
    if not together and due(arena, slots, 1):
        write_ak8963(arena, slots, fresh(arena, slots, &frames[count], 1, FIELD).data)
        count += 1
    return 0 if arena[slots[SILENT]] != 0.0 else count


cdef int icm_answers_(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *field = arena + slots[TRUE_MAG]
    cdef double own[3]
    cdef int count = 0
    cdef uint8_t *data
    if not sayable(arena, slots):
        return -NOT_FINITE
    if due(arena, slots, 0):
        data = fresh(arena, slots, &frames[count], 0, BURST).data
        write_burst(arena, slots, data, 6, 12)
        hold(arena, slots, data, BURST, HELD_BURST)
        count += 1
    if due(arena, slots, 1):
        data = fresh(arena, slots, &frames[count], 1, 9).data
        own[0], own[1], own[2] = field[0], -field[1], -field[2]
        write_field(arena, slots, own, data, 8)
        hold(arena, slots, data, 9, HELD_FIELD)
        count += 1
    return 0 if arena[slots[SILENT]] != 0.0 else count


mpu_decode = export_decode(mpu_decode_)
icm_decode = export_decode(icm_decode_)
mpu_answers = export_encode(mpu_answers_)
icm_answers = export_encode(icm_answers_)
