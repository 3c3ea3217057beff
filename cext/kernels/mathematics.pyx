# cython: freethreading_compatible=True
"""Arithmetic on signals. NaN passes through every one of them, and an infinity never becomes a finite number."""

from libc.math cimport NAN, ceil, fabs, floor, pow, rint, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport INPUTS, OK, export
from cext.kernels.reduce cimport fold
from cext.kernels.limits cimport finite


cdef int gain_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, gain
    cdef double *u = arena + slots[0]
    cdef double *y = arena + slots[1]
    cdef double factor = arena[slots[2]]
    cdef int i
    for i in range(sizes[1]):
        y[i] = factor * u[i]
    return OK


cdef int sum_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u1 ... un, y, weights[n]
    cdef int count = slots[INPUTS]
    cdef double *y = arena + slots[count]
    cdef double *weights = arena + slots[count + 1]
    cdef double *a = arena + slots[0]
    cdef double *b = arena + slots[1]
    cdef double *c = arena + slots[2]
    cdef double p = weights[0]
    cdef double q, r, total
    cdef int i, k
    if count == 2:
        q = weights[1]
        for i in range(sizes[count]):
            y[i] = p * a[i] + q * b[i]
    elif count == 3:
        q, r = weights[1], weights[2]
        for i in range(sizes[count]):
            y[i] = p * a[i] + q * b[i] + r * c[i]
    else:
        for i in range(sizes[count]):
            total = p * a[i]
            for k in range(1, count):
                total += weights[k] * arena[slots[k] + i]
            y[i] = total
    return OK


cdef int product_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # a, b, y; a scalar goes with every element
    cdef int p = sizes[0] > 1
    cdef int q = sizes[1] > 1
    cdef int i
    for i in range(sizes[2]):
        arena[slots[2] + i] = arena[slots[0] + p * i] * arena[slots[1] + q * i]
    return OK


cdef int divide_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # a, b, y; a scalar goes with every element
    cdef int p = sizes[0] > 1
    cdef int q = sizes[1] > 1
    cdef int i
    for i in range(sizes[2]):
        arena[slots[2] + i] = arena[slots[0] + p * i] / finite(arena[slots[1] + q * i])
    return OK


cdef int magnitude_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = fabs(arena[slots[0] + i])
    return OK


cdef int sign_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef double x
    cdef int i
    for i in range(sizes[1]):
        x = finite(arena[slots[0] + i])
        arena[slots[1] + i] = 1.0 if x > 0.0 else -1.0 if x < 0.0 else x        # a zero, or NaN
    return OK


cdef inline double smaller(double a, double b) noexcept nogil:
    a, b = finite(a), finite(b)
    return a if a < b or a != a else b                      # C's fmin would drop a NaN


cdef inline double larger(double a, double b) noexcept nogil:
    a, b = finite(a), finite(b)
    return a if a > b or a != a else b


cdef int min_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return fold(arena, slots, sizes, smaller)


cdef int max_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return fold(arena, slots, sizes, larger)


cdef int round_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = rint(arena[slots[0] + i])
    return OK


cdef int floor_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = floor(arena[slots[0] + i])
    return OK


cdef int ceil_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = ceil(arena[slots[0] + i])
    return OK


cdef int square_root_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = sqrt(arena[slots[0] + i])
    return OK


cdef int power_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, exponent
    cdef double p = arena[slots[2]]
    cdef bint whole = p == floor(p)
    cdef double x
    cdef int i
    for i in range(sizes[1]):
        x = arena[slots[0] + i] if p > 0.0 else finite(arena[slots[0] + i])
        # C has pow(NaN, 0) = 1, pow(inf, -1) = 0 and pow(-inf, 0.5) = inf.
        arena[slots[1] + i] = x if x != x else NAN if x < 0.0 and not whole else pow(x, p)
    return OK


cdef int polynomial_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, terms[n], the highest power first
    cdef double *c = arena + slots[2]
    cdef double x, y
    cdef int i, k
    for i in range(sizes[1]):
        x = arena[slots[0] + i]
        y = c[0]
        for k in range(1, sizes[2]):
            y = y * x + c[k]
        arena[slots[1] + i] = y - (x - x)                   # a constant does not depend on x, but NaN passes, and infinity as NaN
    return OK


cdef int conversion_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, factor, offset
    cdef double factor = arena[slots[2]]
    cdef double offset = arena[slots[3]]
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = factor * arena[slots[0] + i] + offset
    return OK


gain = export(gain_kernel)
sum = export(sum_kernel)
product = export(product_kernel)
divide = export(divide_kernel)
magnitude = export(magnitude_kernel)
sign = export(sign_kernel)
min = export(min_kernel)
max = export(max_kernel)
roundings = {"nearest": export(round_kernel), "floor": export(floor_kernel), "ceil": export(ceil_kernel)}
square_root = export(square_root_kernel)
power = export(power_kernel)
polynomial = export(polynomial_kernel)
conversion = export(conversion_kernel)
