# cython: freethreading_compatible=True
"""Quaternions, w first, Hamilton's product. What turns something is normalised first. NaN passes."""

from libc.math cimport atan2, cos, fabs, sin, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport OK, export


cdef int multiply_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # p[4], q[4], y[4]
    cdef double *p = arena + slots[0]
    cdef double *q = arena + slots[1]
    cdef double *y = arena + slots[2]
    y[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    y[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    y[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    return OK


cdef int conjugate_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # q[4], y[4]
    cdef double *q = arena + slots[0]
    cdef double *y = arena + slots[1]
    y[0] = q[0]
    y[1] = -q[1]
    y[2] = -q[2]
    y[3] = -q[3]
    return OK


cdef inline double scaled(const double *q, double *s) noexcept nogil:
    """q over its largest element, into s, so that nothing overflows; returns |s|², 1 to 4, or NaN for a q without direction."""
    cdef double largest = fabs(q[0])
    cdef int i
    for i in range(1, 4):
        if not fabs(q[i]) <= largest:
            largest = fabs(q[i])
    for i in range(4):
        s[i] = q[i] / largest
    return s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + s[3] * s[3]


cdef int rotate_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # q[4], v[3], y[3]: v' = v + 2 (w (r × v) + r × (r × v)) / |q|², r the vector part of q
    cdef double[4] q
    cdef double twice = 2.0 / scaled(arena + slots[0], q)
    cdef double *v = arena + slots[1]
    cdef double *y = arena + slots[2]
    cdef double cx = q[2] * v[2] - q[3] * v[1]
    cdef double cy = q[3] * v[0] - q[1] * v[2]
    cdef double cz = q[1] * v[1] - q[2] * v[0]
    y[0] = v[0] + twice * (q[0] * cx + q[2] * cz - q[3] * cy)
    y[1] = v[1] + twice * (q[0] * cy + q[3] * cx - q[1] * cz)
    y[2] = v[2] + twice * (q[0] * cz + q[1] * cy - q[2] * cx)
    return OK


cdef inline double within_one(double x) noexcept nogil:
    return 1.0 if x > 1.0 else -1.0 if x < -1.0 else x


cdef int from_euler_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # yaw, pitch, roll, q[4]
    cdef double cy = cos(0.5 * arena[slots[0]])
    cdef double sy = sin(0.5 * arena[slots[0]])
    cdef double cp = cos(0.5 * arena[slots[1]])
    cdef double sp = sin(0.5 * arena[slots[1]])
    cdef double cr = cos(0.5 * arena[slots[2]])
    cdef double sr = sin(0.5 * arena[slots[2]])
    cdef double *q = arena + slots[3]
    q[0] = within_one(cr * cp * cy + sr * sp * sy)
    q[1] = within_one(sr * cp * cy - cr * sp * sy)
    q[2] = within_one(cr * sp * cy + sr * cp * sy)
    q[3] = within_one(cr * cp * sy - sr * sp * cy)
    return OK


cdef int to_euler_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # q[4], yaw, pitch, roll, by the elements of the rotation matrix, here all times |q|² / 2
    cdef double[4] q
    cdef double norm = scaled(arena + slots[0], q)
    cdef double forward = 0.5 * norm - q[2] * q[2] - q[3] * q[3]
    cdef double left = q[1] * q[2] + q[0] * q[3]
    cdef double down = q[0] * q[2] - q[1] * q[3]
    cdef double level = sqrt(forward * forward + left * left)
    arena[slots[2]] = atan2(down, level)
    if level < 1e-7 * norm:     # nose up or down: yaw and roll turn about one axis, and roll is taken as 0
        arena[slots[1]] = atan2(q[0] * q[3] - q[1] * q[2], 0.5 * norm - q[1] * q[1] - q[3] * q[3])
        arena[slots[3]] = 0.0
    else:
        arena[slots[1]] = atan2(left, forward)
        arena[slots[3]] = atan2(q[2] * q[3] + q[0] * q[1], 0.5 * norm - q[1] * q[1] - q[2] * q[2])
    return OK


multiply = export(multiply_kernel)
conjugate = export(conjugate_kernel)
rotate = export(rotate_kernel)
from_euler = export(from_euler_kernel)
to_euler = export(to_euler_kernel)
