# cython: freethreading_compatible=True
"""Sensors on a walking adult: inertial sensors on segments."""

from libc.math cimport cos, sin, sqrt
from libc.stdint cimport int32_t, uint64_t

from cext.abi cimport DT, ITEMS, OK, TICK, export, items, kernel_t
from cext.kernels.philox cimport normals, philox

cdef enum: # in `motion` of a segment, as walker.pyx writes it
    AX = 4
    AZ = 5
    PITCH, RATE, ANGULAR


cdef struct SegmentIMU:
    int32_t motion, accel, gyro, quaternion
    int32_t along, forward, accel_noise, gyro_noise, gyro_drift, seed
    int32_t rotation            # of the sensor in the segment: nine numbers by rows, then the quaternion
    int32_t accel_offset, gyro_offset
    int32_t drift               # of the gyroscope, rad/s

SEGMENT_IMU = items((<SegmentIMU *>ITEMS)[0], "motion[9] accel[3] gyro[3] quaternion[4] rotation[13] "
    "accel_offset[3] gyro_offset[3] drift[3]")


cdef int segment_imu_kernel(double *arena, const SegmentIMU *at, const SegmentIMU *sizes) noexcept nogil:
    cdef const double *motion = arena + at.motion
    cdef const double *rotation = arena + at.rotation
    cdef const double *q = rotation + 9
    cdef double s = sin(motion[PITCH])
    cdef double c = cos(motion[PITCH])
    cdef double w = motion[RATE]
    # 1. Acceleration of the point, x forward and z up, from that of the proximal joint.
    cdef double rx = arena[at.along] * s + arena[at.forward] * c
    cdef double rz = arena[at.forward] * s - arena[at.along] * c
    cdef double ax = motion[AX] - motion[ANGULAR] * rz - w * w * rx
    cdef double az = motion[AZ] + motion[ANGULAR] * rx - w * w * rz + 9.80665
    # 2. Specific force in the segment, x forward, y right, z down; then in the sensor.
    cdef double fx = c * ax + s * az
    cdef double fz = s * ax - c * az
    cdef double half_s = sin(0.5 * motion[PITCH])
    cdef double half_c = cos(0.5 * motion[PITCH])
    cdef double[12] z
    cdef uint64_t[4] bits
    cdef bint random = arena[at.accel_noise] != 0.0 or arena[at.gyro_noise] != 0.0 or arena[at.gyro_drift] != 0.0
    cdef int k
    for k in range(12):
        z[k] = 0.0
    if random:
        for k in range(3):
            philox(3 * <uint64_t>arena[TICK] + k, <uint64_t>arena[at.seed], bits)
            normals(bits, z + 4 * k)
    for k in range(3):
        arena[at.drift + k] += arena[at.gyro_drift] * sqrt(arena[DT]) * z[6 + k]
        arena[at.accel + k] = (rotation[k] * fx + rotation[6 + k] * fz + arena[at.accel_offset + k]
            + arena[at.accel_noise] * z[k])
        arena[at.gyro + k] = (rotation[3 + k] * w + arena[at.gyro_offset + k] + arena[at.drift + k]
            + arena[at.gyro_noise] * z[3 + k])
    arena[at.quaternion] = half_c * q[0] - half_s * q[2]
    arena[at.quaternion + 1] = half_c * q[1] + half_s * q[3]
    arena[at.quaternion + 2] = half_c * q[2] + half_s * q[0]
    arena[at.quaternion + 3] = half_c * q[3] - half_s * q[1]
    return OK


segment_imu = export(<kernel_t>segment_imu_kernel, SEGMENT_IMU)
