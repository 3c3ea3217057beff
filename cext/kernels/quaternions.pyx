# cython: freethreading_compatible=True
"""Quaternions, w first, Hamilton's product. A quaternion that rotates is normalised first. NaN passes."""

from libc.math cimport atan2, cos, fabs, sin, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, export, items, kernel_t


cdef struct Multiply:
    int32_t p, q, y

MULTIPLY = items((<Multiply *>ITEMS)[0], "p[4] q[4] y[4]")


cdef int multiply_kernel(double *arena, const Multiply *at, const Multiply *sizes) noexcept nogil:
    cdef double *p = arena + at.p
    cdef double *q = arena + at.q
    cdef double *y = arena + at.y
    y[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    y[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    y[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    return OK


cdef struct Conjugate:
    int32_t q, y

CONJUGATE = items((<Conjugate *>ITEMS)[0], "q[4] y[4]")


cdef int conjugate_kernel(double *arena, const Conjugate *at, const Conjugate *sizes) noexcept nogil:
    cdef double *q = arena + at.q
    cdef double *y = arena + at.y
    y[0] = q[0]
    y[1] = -q[1]
    y[2] = -q[2]
    y[3] = -q[3]
    return OK


cdef inline double scaled(const double *q, double *s) noexcept nogil:
    """Write q divided by its largest element to s, against overflow. Returns |s|², 1 to 4; NaN for a zero q."""
    cdef double largest = fabs(q[0])
    cdef int i
    for i in range(1, 4):
        if not fabs(q[i]) <= largest:
            largest = fabs(q[i])
    for i in range(4):
        s[i] = q[i] / largest
    return s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + s[3] * s[3]


cdef struct Rotate:
    int32_t q, v, y

ROTATE = items((<Rotate *>ITEMS)[0], "q[4] v[3] y[3]")


cdef int rotate_kernel(double *arena, const Rotate *at, const Rotate *sizes) noexcept nogil:
    """Compute v' = v + 2 (w (r × v) + r × (r × v)) / |q|², r being the vector part of q."""
    cdef double[4] q
    cdef double twice = 2.0 / scaled(arena + at.q, q)
    cdef double *v = arena + at.v
    cdef double *y = arena + at.y
    cdef double cx = q[2] * v[2] - q[3] * v[1]
    cdef double cy = q[3] * v[0] - q[1] * v[2]
    cdef double cz = q[1] * v[1] - q[2] * v[0]
    y[0] = v[0] + twice * (q[0] * cx + q[2] * cz - q[3] * cy)
    y[1] = v[1] + twice * (q[0] * cy + q[3] * cx - q[1] * cz)
    y[2] = v[2] + twice * (q[0] * cz + q[1] * cy - q[2] * cx)
    return OK


cdef inline double within_one(double x) noexcept nogil:
    return 1.0 if x > 1.0 else -1.0 if x < -1.0 else x


cdef struct FromEuler:
    int32_t yaw, pitch, roll, q

FROM_EULER = items((<FromEuler *>ITEMS)[0], "q[4]")


cdef int from_euler_kernel(double *arena, const FromEuler *at, const FromEuler *sizes) noexcept nogil:
    cdef double cy = cos(0.5 * arena[at.yaw])
    cdef double sy = sin(0.5 * arena[at.yaw])
    cdef double cp = cos(0.5 * arena[at.pitch])
    cdef double sp = sin(0.5 * arena[at.pitch])
    cdef double cr = cos(0.5 * arena[at.roll])
    cdef double sr = sin(0.5 * arena[at.roll])
    cdef double *q = arena + at.q
    q[0] = within_one(cr * cp * cy + sr * sp * sy)
    q[1] = within_one(sr * cp * cy - cr * sp * sy)
    q[2] = within_one(cr * sp * cy + sr * cp * sy)
    q[3] = within_one(cr * cp * sy - sr * sp * cy)
    return OK


cdef struct ToEuler:
    int32_t q, yaw, pitch, roll

TO_EULER = items((<ToEuler *>ITEMS)[0], "q[4]")


cdef int to_euler_kernel(double *arena, const ToEuler *at, const ToEuler *sizes) noexcept nogil:
    cdef double[4] q
    cdef double norm = scaled(arena + at.q, q)
    cdef double forward = 0.5 * norm - q[2] * q[2] - q[3] * q[3]
    cdef double left = q[1] * q[2] + q[0] * q[3]
    cdef double down = q[0] * q[2] - q[1] * q[3]
    cdef double level = sqrt(forward * forward + left * left)
    arena[at.pitch] = atan2(down, level)
    if level < 1e-7 * norm:     # x axis vertical: yaw and roll share an axis, roll is set to 0
        arena[at.yaw] = atan2(q[0] * q[3] - q[1] * q[2], 0.5 * norm - q[1] * q[1] - q[3] * q[3])
        arena[at.roll] = 0.0
    else:
        arena[at.yaw] = atan2(left, forward)
        arena[at.roll] = atan2(q[2] * q[3] + q[0] * q[1], 0.5 * norm - q[1] * q[1] - q[2] * q[2])
    return OK


multiply = export(<kernel_t>multiply_kernel, MULTIPLY)
conjugate = export(<kernel_t>conjugate_kernel, CONJUGATE)
rotate = export(<kernel_t>rotate_kernel, ROTATE)
from_euler = export(<kernel_t>from_euler_kernel, FROM_EULER)
to_euler = export(<kernel_t>to_euler_kernel, TO_EULER)
