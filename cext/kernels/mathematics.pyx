# cython: freethreading_compatible=True
"""Arithmetic on signals. NaN passes through every block, and an infinity never becomes a finite number."""

from libc.math cimport NAN, ceil, fabs, floor, pow, rint, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, Rest, each, export, items, kernel_t
from cext.kernels.reduce cimport Fold, fold
from cext.kernels.limits cimport finite


cdef struct Gain:
    int32_t u, y, gain

GAIN = items((<Gain *>ITEMS)[0], "u[...] y[...]")


cdef int gain_kernel(double *arena, const Gain *at, const Gain *sizes) noexcept nogil:
    cdef double *u = arena + at.u
    cdef double *y = arena + at.y
    cdef double factor = arena[at.gain]
    cdef int i
    for i in range(sizes.y):
        y[i] = factor * u[i]
    return OK


cdef struct Sum:
    int32_t y, weights
    Rest inputs

SUM = items((<Sum *>ITEMS)[0], "y[...] weights[...]")


cdef inline int weighted_sum(
        double *arena, const Sum *at, const Sum *sizes, double p, double q, double r, const double *weights) noexcept nogil:
    """Add the inputs. p, q, r : weights of up to three inputs; weights : of more"""
    cdef const int32_t *inputs = each(at, at.inputs)
    cdef int count = at.inputs.count
    cdef double *y = arena + at.y
    cdef double *a = arena + inputs[0]
    cdef double *b
    cdef double *c
    cdef double total
    cdef int i, k
    if count == 2:
        b = arena + inputs[1]
        for i in range(sizes.y):
            y[i] = p * a[i] + q * b[i]
    elif count == 3:
        b, c = arena + inputs[1], arena + inputs[2]
        for i in range(sizes.y):
            y[i] = p * a[i] + q * b[i] + r * c[i]
    else:
        for i in range(sizes.y):
            total = p * a[i]
            for k in range(1, count):
                total += weights[k] * arena[inputs[k] + i]
            y[i] = total
    return OK


cdef int sum_kernel(double *arena, const Sum *at, const Sum *sizes) noexcept nogil:
    cdef const double *weights = arena + at.weights
    cdef int count = at.inputs.count
    return weighted_sum(
        arena, at, sizes, weights[0], weights[1] if count > 1 else 0.0, weights[2] if count > 2 else 0.0, weights)


cdef int add_kernel(double *arena, const Sum *at, const Sum *sizes) noexcept nogil:
    return weighted_sum(arena, at, sizes, 1.0, 1.0, 1.0, arena + at.weights)


cdef int subtract_kernel(double *arena, const Sum *at, const Sum *sizes) noexcept nogil:
    return weighted_sum(arena, at, sizes, 1.0, -1.0, 0.0, arena + at.weights)


cdef struct Product:
    int32_t a, b, y

PRODUCT = items((<Product *>ITEMS)[0], "a[...] b[...] y[...]")


cdef int product_kernel(double *arena, const Product *at, const Product *sizes) noexcept nogil:
    # A scalar is combined with every element.
    cdef int p = sizes.a > 1
    cdef int q = sizes.b > 1
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = arena[at.a + p * i] * arena[at.b + q * i]
    return OK


cdef int divide_kernel(double *arena, const Product *at, const Product *sizes) noexcept nogil:
    # A scalar is combined with every element.
    cdef int p = sizes.a > 1
    cdef int q = sizes.b > 1
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = arena[at.a + p * i] / finite(arena[at.b + q * i])
    return OK


cdef struct Function:
    int32_t u, y

FUNCTION = items((<Function *>ITEMS)[0], "u[...] y[...]")


cdef int magnitude_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = fabs(arena[at.u + i])
    return OK


cdef int sign_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    cdef double x
    cdef int i
    for i in range(sizes.y):
        x = finite(arena[at.u + i])
        arena[at.y + i] = 1.0 if x > 0.0 else -1.0 if x < 0.0 else x        # zero or NaN
    return OK


FOLD = items((<Fold *>ITEMS)[0], "y[...]")


cdef inline double smaller(double a, double b) noexcept nogil:
    a, b = finite(a), finite(b)
    return a if a < b or a != a else b                      # fmin would drop a NaN


cdef inline double larger(double a, double b) noexcept nogil:
    a, b = finite(a), finite(b)
    return a if a > b or a != a else b


cdef int min_kernel(double *arena, const Fold *at, const Fold *sizes) noexcept nogil:
    return fold(arena, at, sizes, smaller)


cdef int max_kernel(double *arena, const Fold *at, const Fold *sizes) noexcept nogil:
    return fold(arena, at, sizes, larger)


cdef int round_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = rint(arena[at.u + i])
    return OK


cdef int floor_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = floor(arena[at.u + i])
    return OK


cdef int ceil_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = ceil(arena[at.u + i])
    return OK


cdef int square_root_kernel(double *arena, const Function *at, const Function *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = sqrt(arena[at.u + i])
    return OK


cdef struct Power:
    int32_t u, y, exponent

POWER = items((<Power *>ITEMS)[0], "u[...] y[...]")


cdef int power_kernel(double *arena, const Power *at, const Power *sizes) noexcept nogil:
    cdef double p = arena[at.exponent]
    cdef bint whole = p == floor(p)
    cdef double x
    cdef int i
    for i in range(sizes.y):
        x = arena[at.u + i] if p > 0.0 else finite(arena[at.u + i])
        # C has pow(NaN, 0) = 1, pow(inf, -1) = 0 and pow(-inf, 0.5) = inf.
        arena[at.y + i] = x if x != x else NAN if x < 0.0 and not whole else pow(x, p)
    return OK


cdef struct Polynomial:
    int32_t u, y, terms

POLYNOMIAL = items((<Polynomial *>ITEMS)[0], "u[...] y[...] terms[...]")


cdef int polynomial_kernel(double *arena, const Polynomial *at, const Polynomial *sizes) noexcept nogil:
    cdef double *c = arena + at.terms
    cdef double x, y
    cdef int i, k
    for i in range(sizes.y):
        x = arena[at.u + i]
        y = c[0]
        for k in range(1, sizes.terms):
            y = y * x + c[k]
        arena[at.y + i] = y - (x - x)                   # NaN in x results in NaN, as does infinity
    return OK


cdef struct Conversion:
    int32_t u, y, factor, offset

CONVERSION = items((<Conversion *>ITEMS)[0], "u[...] y[...]")


cdef int conversion_kernel(double *arena, const Conversion *at, const Conversion *sizes) noexcept nogil:
    cdef double factor = arena[at.factor]
    cdef double offset = arena[at.offset]
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = factor * arena[at.u + i] + offset
    return OK


gain = export(<kernel_t>gain_kernel, GAIN)
sum = export(<kernel_t>sum_kernel, SUM)
additions = {                       # by signs: without a multiplication for each input
    "++": export(<kernel_t>add_kernel, SUM),
    "+++": export(<kernel_t>add_kernel, SUM),
    "+-": export(<kernel_t>subtract_kernel, SUM),
}
product = export(<kernel_t>product_kernel, PRODUCT)
divide = export(<kernel_t>divide_kernel, PRODUCT)
magnitude = export(<kernel_t>magnitude_kernel, FUNCTION)
sign = export(<kernel_t>sign_kernel, FUNCTION)
min = export(<kernel_t>min_kernel, FOLD)
max = export(<kernel_t>max_kernel, FOLD)
roundings = {
    "nearest": export(<kernel_t>round_kernel, FUNCTION),
    "floor": export(<kernel_t>floor_kernel, FUNCTION),
    "ceil": export(<kernel_t>ceil_kernel, FUNCTION),
}
square_root = export(<kernel_t>square_root_kernel, FUNCTION)
power = export(<kernel_t>power_kernel, POWER)
polynomial = export(<kernel_t>polynomial_kernel, POLYNOMIAL)
conversion = export(<kernel_t>conversion_kernel, CONVERSION)
