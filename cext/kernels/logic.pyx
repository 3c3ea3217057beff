# cython: freethreading_compatible=True
"""Logic. A bool is 0 or 1, any number except 0 is true, and NaN is neither: it passes through every block."""

from libc.math cimport NAN, floor
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, TIME, Rest, each, export, items, kernel_t
from cext.kernels.clock cimport just_after
from cext.kernels.reduce cimport Fold, fold

cdef extern from "<math.h>" nogil:
    bint isunordered(double a, double b)                    # whether either is NaN

ctypedef bint (*relation_t)(double a, double b) noexcept nogil


cdef inline double truth(double x) noexcept nogil:
    """Return 0, 1 or NaN."""
    return x if x != x else <double>(x != 0.0)


cdef struct Comparison:
    int32_t a, b, y

COMPARISON = items((<Comparison *>ITEMS)[0], "a[...] b[...] y[...]")


cdef inline int compare(double *arena, const Comparison *at, const Comparison *sizes, relation_t holds) noexcept nogil:
    cdef double a, b
    cdef int i
    for i in range(sizes.y):
        a = arena[at.a + i]
        b = arena[at.b + i]
        arena[at.y + i] = NAN if isunordered(a, b) else 1.0 if holds(a, b) else 0.0
    return OK


cdef inline bint less(double a, double b) noexcept nogil: return a < b
cdef inline bint at_most(double a, double b) noexcept nogil: return a <= b
cdef inline bint more(double a, double b) noexcept nogil: return a > b
cdef inline bint at_least(double a, double b) noexcept nogil: return a >= b
cdef inline bint equal(double a, double b) noexcept nogil: return a == b
cdef inline bint unlike(double a, double b) noexcept nogil: return a != b

cdef int less_kernel(double *arena, const Comparison *at,
    const Comparison *sizes) noexcept nogil: return compare(arena, at, sizes, less)
cdef int at_most_kernel(double *arena, const Comparison *at,
    const Comparison *sizes) noexcept nogil: return compare(arena, at, sizes, at_most)
cdef int more_kernel(double *arena, const Comparison *at,
    const Comparison *sizes) noexcept nogil: return compare(arena, at, sizes, more)
cdef int at_least_kernel(double *arena, const Comparison *at,
    const Comparison *sizes) noexcept nogil: return compare(arena, at, sizes, at_least)
cdef int equal_kernel(double *arena, const Comparison *at,
    const Comparison *sizes) noexcept nogil: return compare(arena, at, sizes, equal)
cdef int unlike_kernel(double *arena, const Comparison *at,
    const Comparison *sizes) noexcept nogil: return compare(arena, at, sizes, unlike)


FOLD = items((<Fold *>ITEMS)[0], "y[...]")


cdef inline double both(double a, double b) noexcept nogil:
    return NAN if isunordered(a, b) else 1.0 if a != 0.0 and b != 0.0 else 0.0


cdef inline double either(double a, double b) noexcept nogil:
    return NAN if isunordered(a, b) else 1.0 if a != 0.0 or b != 0.0 else 0.0


cdef inline double odd(double a, double b) noexcept nogil:
    return NAN if isunordered(a, b) else 1.0 if (a != 0.0) != (b != 0.0) else 0.0


cdef int and_kernel(double *arena, const Fold *at, const Fold *sizes) noexcept nogil:
    return fold(arena, at, sizes, both)


cdef int or_kernel(double *arena, const Fold *at, const Fold *sizes) noexcept nogil:
    return fold(arena, at, sizes, either)


cdef int xor_kernel(double *arena, const Fold *at, const Fold *sizes) noexcept nogil:
    return fold(arena, at, sizes, odd)


cdef struct Not:
    int32_t u, y

NOT = items((<Not *>ITEMS)[0], "u[...] y[...]")


cdef int not_kernel(double *arena, const Not *at, const Not *sizes) noexcept nogil:
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = 1.0 - truth(arena[at.u + i])
    return OK


cdef inline double step_of(double *previous, double u) noexcept nogil:
    """Return the change since the last sample other than NaN: 1 up, -1 down, 0 or NaN. The first sample is no
    change.
    """
    cdef double now = truth(u)
    cdef double step
    if now != now:
        return now
    step = now - previous[0] if previous[0] == previous[0] else 0.0
    previous[0] = now
    return step


cdef struct Edge:
    int32_t u, y, previous

EDGE = items((<Edge *>ITEMS)[0])


cdef int rising_kernel(double *arena, const Edge *at, const Edge *sizes) noexcept nogil:
    cdef double step = step_of(arena + at.previous, arena[at.u])
    arena[at.y] = step if step != step else <double>(step > 0.0)
    return OK


cdef int falling_kernel(double *arena, const Edge *at, const Edge *sizes) noexcept nogil:
    cdef double step = step_of(arena + at.previous, arena[at.u])
    arena[at.y] = step if step != step else <double>(step < 0.0)
    return OK


cdef int both_edges_kernel(double *arena, const Edge *at, const Edge *sizes) noexcept nogil:
    cdef double step = step_of(arena + at.previous, arena[at.u])
    arena[at.y] = step * step
    return OK


cdef struct Latch:
    int32_t on, off, y, held

LATCH = items((<Latch *>ITEMS)[0])


cdef int latch_kernel(double *arena, const Latch *at, const Latch *sizes) noexcept nogil:
    cdef double on = arena[at.on]
    cdef double off = arena[at.off]
    if isunordered(on, off):
        arena[at.y] = NAN
        return OK
    if off != 0.0:
        arena[at.held] = 0.0
    elif on != 0.0:
        arena[at.held] = 1.0
    arena[at.y] = arena[at.held]
    return OK


cdef struct Debounce:
    int32_t u, y, time, held, since

DEBOUNCE = items((<Debounce *>ITEMS)[0])


cdef int debounce_kernel(double *arena, const Debounce *at, const Debounce *sizes) noexcept nogil:
    cdef double now = truth(arena[at.u])
    cdef double *held = arena + at.held
    cdef double *since = arena + at.since
    if now != now:
        since[0] = NAN
        arena[at.y] = now
        return OK
    if held[0] != held[0]:
        held[0] = now           # the first sample is accepted
    if now == held[0]:
        since[0] = NAN
    else:
        if since[0] != since[0]:
            since[0] = arena[TIME]
        if just_after(arena) - since[0] >= arena[at.time]:
            held[0] = now
            since[0] = NAN
    arena[at.y] = held[0]
    return OK


cdef struct Counter:
    int32_t u, clear, count, previous, total

COUNTER = items((<Counter *>ITEMS)[0])


cdef int counter_kernel(double *arena, const Counter *at, const Counter *sizes) noexcept nogil:
    cdef double clear = truth(arena[at.clear])
    cdef double step = step_of(arena + at.previous, arena[at.u])
    cdef double *total = arena + at.total
    if step > 0.0:
        total[0] += 1.0
    if clear == 1.0:
        total[0] = 0.0
    arena[at.count] = NAN if isunordered(step, clear) else total[0]
    return OK


cdef struct Timer:
    int32_t restart, elapsed, since

TIMER = items((<Timer *>ITEMS)[0])


cdef int timer_kernel(double *arena, const Timer *at, const Timer *sizes) noexcept nogil:
    cdef double restart = truth(arena[at.restart])
    cdef double *since = arena + at.since
    if since[0] != since[0] or restart == 1.0:
        since[0] = arena[TIME]
    arena[at.elapsed] = restart if restart != restart else arena[TIME] - since[0]
    return OK


cdef struct Switch:
    int32_t condition, a, b, y

SWITCH = items((<Switch *>ITEMS)[0], "a[...] b[...] y[...]")


cdef int switch_kernel(double *arena, const Switch *at, const Switch *sizes) noexcept nogil:
    cdef double condition = arena[at.condition]
    cdef double *chosen = arena + (at.a if condition != 0.0 else at.b)
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = chosen[i] if condition == condition else condition
    return OK


cdef struct Selector:
    int32_t index, y
    Rest inputs

SELECTOR = items((<Selector *>ITEMS)[0], "y[...]")


cdef int select_kernel(double *arena, const Selector *at, const Selector *sizes) noexcept nogil:
    cdef double index = floor(arena[at.index])
    cdef bint exists = index >= 0.0 and index < at.inputs.count
    cdef double *chosen = arena + each(at, at.inputs)[<int>index if exists else 0]
    cdef int i
    for i in range(sizes.y):
        arena[at.y + i] = chosen[i] if exists else NAN
    return OK


relations = {
    "<": export(<kernel_t>less_kernel, COMPARISON), "<=": export(<kernel_t>at_most_kernel, COMPARISON),
    ">": export(<kernel_t>more_kernel, COMPARISON), ">=": export(<kernel_t>at_least_kernel, COMPARISON),
    "==": export(<kernel_t>equal_kernel, COMPARISON), "!=": export(<kernel_t>unlike_kernel, COMPARISON),
}
conjunction = export(<kernel_t>and_kernel, FOLD)
disjunction = export(<kernel_t>or_kernel, FOLD)
parity = export(<kernel_t>xor_kernel, FOLD)
negation = export(<kernel_t>not_kernel, NOT)
edges = {
    "rising": export(<kernel_t>rising_kernel, EDGE),
    "falling": export(<kernel_t>falling_kernel, EDGE),
    "both": export(<kernel_t>both_edges_kernel, EDGE),
}
latch = export(<kernel_t>latch_kernel, LATCH)
debounce = export(<kernel_t>debounce_kernel, DEBOUNCE)
counter = export(<kernel_t>counter_kernel, COUNTER)
timer = export(<kernel_t>timer_kernel, TIMER)
switch = export(<kernel_t>switch_kernel, SWITCH)
select = export(<kernel_t>select_kernel, SELECTOR)
