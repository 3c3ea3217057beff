# cython: freethreading_compatible=True
"""Interpolation tables. NaN passes, and infinity becomes NaN."""

from libc.stdint cimport int32_t

from cext.abi cimport FIRST_OWN_STATUS, ITEMS, OK, export, items, kernel_t
from cext.kernels.interpolation cimport along, between, segment, share_of
from cext.kernels.limits cimport finite

cdef enum:
    BEYOND_THE_ENDS = FIRST_OWN_STATUS

ctypedef double (*line_t)(double a, double b, double share) noexcept nogil


cdef struct Curve:
    int32_t u, y, knots, heights

CURVE = items((<Curve *>ITEMS)[0], "u[...] y[...] knots[...] heights[...]")


cdef inline int curve(double *arena, const Curve *at, const Curve *sizes, line_t line) noexcept nogil:
    cdef double *knots = arena + at.knots
    cdef double *heights = arena + at.heights
    cdef double x
    cdef int i, k
    for k in range(sizes.y):
        x = finite(arena[at.u + k])
        i = segment(knots, sizes.knots, x)
        arena[at.y + k] = line(heights[i], heights[i + 1], share_of(knots, i, x))
    return OK


cdef inline bint outside(const double *x, int count, const double *knots, int knot_count) noexcept nogil:
    cdef int k
    for k in range(count):
        if x[k] < knots[0] or x[k] > knots[knot_count - 1]:
            return True
    return False


cdef int curve_clamp_kernel(double *arena, const Curve *at, const Curve *sizes) noexcept nogil:
    return curve(arena, at, sizes, between)


cdef int curve_extrapolate_kernel(double *arena, const Curve *at, const Curve *sizes) noexcept nogil:
    return curve(arena, at, sizes, along)


cdef int curve_error_kernel(double *arena, const Curve *at, const Curve *sizes) noexcept nogil:
    if outside(arena + at.u, sizes.u, arena + at.knots, sizes.knots):
        return BEYOND_THE_ENDS
    return curve(arena, at, sizes, between)


cdef struct Surface:
    int32_t row, column, y, row_knots, column_knots, heights

SURFACE = items((<Surface *>ITEMS)[0], "row[...] column[...] y[...] row_knots[...] column_knots[...] heights[...]")


cdef inline int surface(double *arena, const Surface *at, const Surface *sizes, line_t line) noexcept nogil:
    cdef double *rows = arena + at.row_knots
    cdef double *columns = arena + at.column_knots
    cdef int m = sizes.column_knots
    cdef double *corner
    cdef double r, c, share
    cdef int i, j, k
    for k in range(sizes.y):
        r = finite(arena[at.row + k])
        c = finite(arena[at.column + k])
        i = segment(rows, sizes.row_knots, r)
        j = segment(columns, m, c)
        share = share_of(columns, j, c)
        corner = arena + at.heights + i * m + j
        arena[at.y + k] = line(line(corner[0], corner[1], share), line(corner[m], corner[m + 1], share),
            share_of(rows, i, r))
    return OK


cdef int surface_clamp_kernel(double *arena, const Surface *at, const Surface *sizes) noexcept nogil:
    return surface(arena, at, sizes, between)


cdef int surface_extrapolate_kernel(double *arena, const Surface *at, const Surface *sizes) noexcept nogil:
    return surface(arena, at, sizes, along)


cdef int surface_error_kernel(double *arena, const Surface *at, const Surface *sizes) noexcept nogil:
    if outside(arena + at.row, sizes.row, arena + at.row_knots, sizes.row_knots) or outside(arena + at.column,
            sizes.column, arena + at.column_knots, sizes.column_knots):
        return BEYOND_THE_ENDS
    return surface(arena, at, sizes, between)


curves = {
    "clamp": export(<kernel_t>curve_clamp_kernel, CURVE),
    "extrapolate": export(<kernel_t>curve_extrapolate_kernel, CURVE),
    "error": export(<kernel_t>curve_error_kernel, CURVE),
}
surfaces = {
    "clamp": export(<kernel_t>surface_clamp_kernel, SURFACE),
    "extrapolate": export(<kernel_t>surface_extrapolate_kernel, SURFACE),
    "error": export(<kernel_t>surface_error_kernel, SURFACE),
}
