# cython: freethreading_compatible=True
"""Interpolation tables. NaN passes, and infinity becomes NaN."""

from libc.stdint cimport int32_t

from cext.abi cimport FIRST_OWN_STATUS, OK, export
from cext.kernels.interpolation cimport along, between, segment, share_of
from cext.kernels.limits cimport finite

cdef enum:
    BEYOND_THE_ENDS = FIRST_OWN_STATUS

ctypedef double (*line_t)(double a, double b, double share) noexcept nogil


cdef inline int curve(double *arena, const int32_t *slots, const int32_t *sizes, line_t line) noexcept nogil:
    # u, y, knots[n], heights[n]
    cdef double *knots = arena + slots[2]
    cdef double *heights = arena + slots[3]
    cdef double x
    cdef int i, k
    for k in range(sizes[1]):
        x = finite(arena[slots[0] + k])
        i = segment(knots, sizes[2], x)
        arena[slots[1] + k] = line(heights[i], heights[i + 1], share_of(knots, i, x))
    return OK


cdef inline bint outside(const double *x, int count, const double *knots, int knot_count) noexcept nogil:
    cdef int k
    for k in range(count):
        if x[k] < knots[0] or x[k] > knots[knot_count - 1]:
            return True
    return False


cdef int curve_clamp_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return curve(arena, slots, sizes, between)


cdef int curve_extrapolate_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return curve(arena, slots, sizes, along)


cdef int curve_error_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    if outside(arena + slots[0], sizes[0], arena + slots[2], sizes[2]):
        return BEYOND_THE_ENDS
    return curve(arena, slots, sizes, between)


cdef inline int surface(double *arena, const int32_t *slots, const int32_t *sizes, line_t line) noexcept nogil:
    # row, column, y, row_knots[n], column_knots[m], heights[n m], one row after the other
    cdef double *rows = arena + slots[3]
    cdef double *columns = arena + slots[4]
    cdef int m = sizes[4]
    cdef double *corner
    cdef double r, c, share
    cdef int i, j, k
    for k in range(sizes[2]):
        r = finite(arena[slots[0] + k])
        c = finite(arena[slots[1] + k])
        i = segment(rows, sizes[3], r)
        j = segment(columns, m, c)
        share = share_of(columns, j, c)
        corner = arena + slots[5] + i * m + j
        arena[slots[2] + k] = line(line(corner[0], corner[1], share), line(corner[m], corner[m + 1], share), share_of(rows, i, r))
    return OK


cdef int surface_clamp_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return surface(arena, slots, sizes, between)


cdef int surface_extrapolate_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return surface(arena, slots, sizes, along)


cdef int surface_error_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    if outside(arena + slots[0], sizes[0], arena + slots[3], sizes[3]) or outside(arena + slots[1], sizes[1], arena + slots[4], sizes[4]):
        return BEYOND_THE_ENDS
    return surface(arena, slots, sizes, between)


curves = {"clamp": export(curve_clamp_kernel), "extrapolate": export(curve_extrapolate_kernel), "error": export(curve_error_kernel)}
surfaces = {"clamp": export(surface_clamp_kernel), "extrapolate": export(surface_extrapolate_kernel), "error": export(surface_error_kernel)}
