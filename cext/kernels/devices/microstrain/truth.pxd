"""What an emulated MicroStrain sensor measures, and the data of its fields.

The sensor-to-vehicle rotation turns accelerations, angular rates, magnetic field and the attitude of the estimation
filter into the vehicle's axes; on the newer generation also the attitude of the complementary filter. (MIP SDK 4.0,
commands 0C 31 and 0D 11)
"""

from libc.math cimport NAN, asin, atan2
from libc.stdint cimport int32_t, uint8_t, uint16_t, uint64_t

from cext.kernels.devices.microstrain.mip cimport product, put_16, put_64, put_double, put_float, to_matrix

cdef enum:
    DATA_ROOM = 40              # bytes of the longest field's data

cdef struct Truth:
    double accel[3]             # m/s²
    double gyro[3]              # rad/s
    double mag[3]               # µT
    double temperature          # °C
    double filter[4]            # attitude of the estimation filter
    double sensor[4]            # attitude of the complementary filter
    double clock                # s
    double period               # s between samples of the field
    int32_t valid               # whether the filter marks its values as valid
    int32_t spoilt              # whether all values are NaN


cdef inline void turn_vector(const double *r, double *vector) noexcept nogil:
    """Replace a vector in the sensor's axes by that in the vehicle's. r : matrix from vehicle to sensor"""
    cdef double x = vector[0]
    cdef double y = vector[1]
    cdef double z = vector[2]
    cdef int i
    for i in range(3):
        vector[i] = r[i] * x + r[3 + i] * y + r[6 + i] * z


cdef inline void turn_attitude(const double *mounting, double *q) noexcept nogil:
    """Replace the attitude of the sensor by that of the vehicle."""
    cdef double conjugate[4]
    cdef double turned[4]
    cdef int i
    for i in range(4):
        conjugate[i] = q[i] if i == 0 else -q[i]
    product(conjugate, mounting, turned)
    for i in range(4):
        q[i] = turned[i]


cdef inline void mount(Truth *truth, const double *mounting, bint whole) noexcept nogil:
    """Express the measurements in the vehicle's axes.

    mounting : rotation from the vehicle's axes to the sensor's, w first; whole : including the complementary filter
    """
    cdef double r[9]
    to_matrix(mounting, r)
    turn_vector(r, truth.accel)
    turn_vector(r, truth.gyro)
    turn_vector(r, truth.mag)
    turn_attitude(mounting, truth.filter)
    if whole:
        turn_attitude(mounting, truth.sensor)


cdef inline int floats(const Truth *truth, uint8_t *out, const double *values, int count, double scale,
        bint flagged) noexcept nogil:
    cdef int index
    for index in range(count):
        put_float(out + 4 * index, NAN if truth.spoilt else values[index] * scale)
    if flagged:
        put_16(out + 4 * count, <uint16_t>truth.valid)
    return 4 * count + (2 if flagged else 0)


cdef inline int attitude(const Truth *truth, uint8_t *out, const double *q, int kind, bint flagged) noexcept nogil:
    """Write an attitude as a quaternion (0), matrix from the earth's axes (1), or roll, pitch and yaw (2)."""
    cdef double r[9]
    cdef double values[9]
    cdef int i, j
    if kind == 0:
        return floats(truth, out, q, 4, 1.0, flagged)
    to_matrix(q, r)
    if kind == 1:
        for i in range(3):
            for j in range(3):
                values[3 * i + j] = r[3 * j + i]
        return floats(truth, out, values, 9, 1.0, flagged)
    values[0], values[1], values[2] = atan2(r[7], r[8]), asin(max(-1.0, min(1.0, -r[6]))), atan2(r[3], r[0])
    return floats(truth, out, values, 3, 1.0, flagged)


cdef inline int fill(const Truth *truth, int descriptor_set, int descriptor, uint8_t *out) noexcept nogil:
    """Write the data of a field. Returns their length, 0 for an unknown field."""
    cdef double values[3]
    cdef bint filtered = descriptor_set == 0x82
    cdef int key = descriptor_set << 8 | descriptor
    cdef int index
    for index in range(3):
        values[index] = 0.0
    if descriptor == 0xD5:
        put_64(out, <uint64_t>(truth.clock * 1e9 + 0.5))
        return 8
    if descriptor == 0xD3 or key == 0x8012 or key == 0x8211:
        put_double(out, truth.clock)
        put_16(out + 8, 0)
        put_16(out + 10, 1)
        return 12
    if descriptor == 0xD4:
        put_double(out, truth.period)
        return 8
    if key == 0x8210:
        put_16(out, 2 if truth.valid else 1)
        put_16(out + 2, 2)
        put_16(out + 4, 0)
        return 6
    if key == 0x8004 or key == 0x8011 or key == 0x821C or key == 0x820D:
        return floats(truth, out, truth.accel, 3, 1.0 if filtered else 1.0 / 9.80665, filtered)
    if key == 0x8005 or key == 0x820E:
        return floats(truth, out, truth.gyro, 3, 1.0, filtered)
    if key == 0x8006 or key == 0x8010:
        return floats(truth, out, truth.mag, 3, 0.01, False)
    if key == 0x8009 or key == 0x800A or key == 0x800C:
        return attitude(truth, out, truth.sensor, 1 if descriptor == 0x09 else 0 if descriptor == 0x0A else 2, False)
    if key == 0x8203 or key == 0x8204 or key == 0x8205:
        return attitude(truth, out, truth.filter, descriptor - 0x03, True)
    if key == 0x8014:
        values[0] = values[1] = values[2] = truth.temperature
        return floats(truth, out, values, 3, 1.0, False)
    if key == 0x8017:
        values[0] = 1013.25
        return floats(truth, out, values, 1, 1.0, False)
    if key == 0x8007 or key == 0x8008:
        for index in range(3):
            values[index] = truth.period * (truth.gyro[index] if descriptor == 0x07 else truth.accel[index] / 9.80665)
        return floats(truth, out, values, 3, 1.0, False)
    if key == 0x8206 or key == 0x8213:
        values[2] = 9.80665 if descriptor == 0x13 else 0.0
        return floats(truth, out, values, 3, 1.0, True)
    return 0
