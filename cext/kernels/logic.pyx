# cython: freethreading_compatible=True
"""Logic. A bool is 0 or 1, anything but 0 is true, and NaN is neither: it passes through every one of these."""

from libc.math cimport NAN, floor
from libc.stdint cimport int32_t

from cext.abi cimport INPUTS, OK, TIME, export
from cext.kernels.clock cimport just_after
from cext.kernels.reduce cimport fold

cdef extern from "<math.h>" nogil:
    bint isunordered(double a, double b)                    # whether one of them is NaN

ctypedef bint (*relation_t)(double a, double b) noexcept nogil


cdef inline double truth(double x) noexcept nogil:
    """0, 1 or NaN."""
    return x if x != x else <double>(x != 0.0)


cdef inline int compare(double *arena, const int32_t *slots, const int32_t *sizes, relation_t holds) noexcept nogil:
    # a, b, y
    cdef double a, b
    cdef int i
    for i in range(sizes[2]):
        a = arena[slots[0] + i]
        b = arena[slots[1] + i]
        arena[slots[2] + i] = NAN if isunordered(a, b) else 1.0 if holds(a, b) else 0.0
    return OK


cdef inline bint less(double a, double b) noexcept nogil: return a < b
cdef inline bint at_most(double a, double b) noexcept nogil: return a <= b
cdef inline bint more(double a, double b) noexcept nogil: return a > b
cdef inline bint at_least(double a, double b) noexcept nogil: return a >= b
cdef inline bint equal(double a, double b) noexcept nogil: return a == b
cdef inline bint unlike(double a, double b) noexcept nogil: return a != b

cdef int less_kernel(double *a, const int32_t *s, const int32_t *n) noexcept nogil: return compare(a, s, n, less)
cdef int at_most_kernel(double *a, const int32_t *s, const int32_t *n) noexcept nogil: return compare(a, s, n, at_most)
cdef int more_kernel(double *a, const int32_t *s, const int32_t *n) noexcept nogil: return compare(a, s, n, more)
cdef int at_least_kernel(double *a, const int32_t *s, const int32_t *n) noexcept nogil: return compare(a, s, n, at_least)
cdef int equal_kernel(double *a, const int32_t *s, const int32_t *n) noexcept nogil: return compare(a, s, n, equal)
cdef int unlike_kernel(double *a, const int32_t *s, const int32_t *n) noexcept nogil: return compare(a, s, n, unlike)


cdef inline double both(double a, double b) noexcept nogil:
    return NAN if isunordered(a, b) else 1.0 if a != 0.0 and b != 0.0 else 0.0


cdef inline double either(double a, double b) noexcept nogil:
    return NAN if isunordered(a, b) else 1.0 if a != 0.0 or b != 0.0 else 0.0


cdef inline double odd(double a, double b) noexcept nogil:
    return NAN if isunordered(a, b) else 1.0 if (a != 0.0) != (b != 0.0) else 0.0


cdef int and_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return fold(arena, slots, sizes, both)


cdef int or_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return fold(arena, slots, sizes, either)


cdef int xor_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return fold(arena, slots, sizes, odd)


cdef int not_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y
    cdef int i
    for i in range(sizes[1]):
        arena[slots[1] + i] = 1.0 - truth(arena[slots[0] + i])
    return OK


cdef inline double step_of(double *previous, double u) noexcept nogil:
    """From the last sample that was not NaN to this one: 1 up, -1 down, 0 or NaN. The first is no step."""
    cdef double now = truth(u)
    cdef double step
    if now != now:
        return now
    step = now - previous[0] if previous[0] == previous[0] else 0.0
    previous[0] = now
    return step


cdef int rising_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, previous
    cdef double step = step_of(arena + slots[2], arena[slots[0]])
    arena[slots[1]] = step if step != step else <double>(step > 0.0)
    return OK


cdef int falling_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double step = step_of(arena + slots[2], arena[slots[0]])
    arena[slots[1]] = step if step != step else <double>(step < 0.0)
    return OK


cdef int both_edges_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    cdef double step = step_of(arena + slots[2], arena[slots[0]])
    arena[slots[1]] = step * step
    return OK


cdef int latch_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # on, off, y, initial, held
    cdef double on = arena[slots[0]]
    cdef double off = arena[slots[1]]
    if isunordered(on, off):
        arena[slots[2]] = NAN
        return OK
    if off != 0.0:
        arena[slots[4]] = 0.0
    elif on != 0.0:
        arena[slots[4]] = 1.0
    arena[slots[2]] = arena[slots[4]]
    return OK


cdef int debounce_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, y, time, held, since
    cdef double now = truth(arena[slots[0]])
    cdef double *held = arena + slots[3]
    cdef double *since = arena + slots[4]
    if now != now:
        since[0] = NAN
        arena[slots[1]] = now
        return OK
    if held[0] != held[0]:
        held[0] = now           # the first sample is believed
    if now == held[0]:
        since[0] = NAN
    else:
        if since[0] != since[0]:
            since[0] = arena[TIME]
        if just_after(arena) - since[0] >= arena[slots[2]]:
            held[0] = now
            since[0] = NAN
    arena[slots[1]] = held[0]
    return OK


cdef int counter_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # u, clear, count, previous, total
    cdef double clear = truth(arena[slots[1]])
    cdef double step = step_of(arena + slots[3], arena[slots[0]])
    cdef double *total = arena + slots[4]
    if step > 0.0:
        total[0] += 1.0
    if clear == 1.0:
        total[0] = 0.0
    arena[slots[2]] = NAN if isunordered(step, clear) else total[0]
    return OK


cdef int timer_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # restart, elapsed, since
    cdef double restart = truth(arena[slots[0]])
    cdef double *since = arena + slots[2]
    if since[0] != since[0] or restart == 1.0:
        since[0] = arena[TIME]
    arena[slots[1]] = restart if restart != restart else arena[TIME] - since[0]
    return OK


cdef int switch_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # condition, a, b, y
    cdef double condition = arena[slots[0]]
    cdef double *chosen = arena + (slots[1] if condition != 0.0 else slots[2])
    cdef int i
    for i in range(sizes[3]):
        arena[slots[3] + i] = chosen[i] if condition == condition else condition
    return OK


cdef int select_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    # index, u0 ... un-1, y
    cdef int count = slots[INPUTS] - 1
    cdef double index = floor(arena[slots[0]])
    cdef bint there = index >= 0.0 and index < count
    cdef double *chosen = arena + slots[1 + <int>index if there else 1]
    cdef int i
    for i in range(sizes[1 + count]):
        arena[slots[1 + count] + i] = chosen[i] if there else NAN
    return OK


relations = {
    "<": export(less_kernel), "<=": export(at_most_kernel), ">": export(more_kernel), ">=": export(at_least_kernel),
    "==": export(equal_kernel), "!=": export(unlike_kernel),
}
conjunction = export(and_kernel)
disjunction = export(or_kernel)
parity = export(xor_kernel)
negation = export(not_kernel)
edges = {"rising": export(rising_kernel), "falling": export(falling_kernel), "both": export(both_edges_kernel)}
latch = export(latch_kernel)
debounce = export(debounce_kernel)
counter = export(counter_kernel)
timer = export(timer_kernel)
switch = export(switch_kernel)
select = export(select_kernel)
