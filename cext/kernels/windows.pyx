# cython: freethreading_compatible=True
"""Statistics of the last N inputs, in fixed memory and without drift.

Sums. Principle: 1. a ring holds the inputs; 2. the running sum adds each new one and subtracts the oldest; 3. a fresh
sum adds the inputs since the ring last wrapped; when the ring wraps, the fresh sum is that of the whole window and
replaces the running one; 4. both keep their rounding error in a second double; 5. non-finite inputs are counted and not
added, so that they leave no error behind.

Extremes. A monotonic queue: an input followed by a larger one can no longer be the maximum, and is dropped.
"""

from libc.math cimport NAN, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport ITEMS, OK, export, items, kernel_t
from cext.kernels.limits cimport finite, is_finite
from cext.kernels.compensated_sum cimport FRESH, RUNNING, RUNNING_REST, add, begin_anew

cdef enum: # in `sums`, for each element, after the two sums
    STRANGE = 4                 # number of non-finite inputs in the window
    SUMS_PER_ELEMENT


cdef struct Sums:
    int32_t u, y, samples, sums, place

SUMS = items((<Sums *>ITEMS)[0], "u[...] y[...] samples[...] sums[...] place[2]")


cdef inline int window_sums(double *arena, const Sums *at, const Sums *sizes, bint squares) noexcept nogil:
    cdef int width = sizes.y
    cdef int length = sizes.samples // width
    cdef int place = <int>arena[at.place]
    cdef int count = <int>arena[at.place + 1]
    cdef bint full = count == length
    cdef double *samples = arena + at.samples + place * width
    cdef double *sums = arena + at.sums
    cdef double x
    cdef int i
    if not full:
        count += 1
    for i in range(width):
        x = arena[at.u + i]
        if squares:
            x = x * x
        if full and is_finite(samples[i]):
            add(sums + RUNNING, -samples[i])
        elif full:
            sums[STRANGE] -= 1.0
        samples[i] = x
        if is_finite(x):
            add(sums + RUNNING, x)
            add(sums + FRESH, x)
        else:
            sums[STRANGE] += 1.0
        if place + 1 == length:
            begin_anew(sums)
        x = (sums[RUNNING] + sums[RUNNING_REST]) / count
        if squares:
            x = sqrt(x) if x > 0.0 else 0.0
        arena[at.y + i] = NAN if sums[STRANGE] > 0.0 else x
        sums += SUMS_PER_ELEMENT
    arena[at.place] = 0.0 if place + 1 == length else place + 1
    arena[at.place + 1] = count
    return OK


cdef int average_kernel(double *arena, const Sums *at, const Sums *sizes) noexcept nogil:
    return window_sums(arena, at, sizes, False)


cdef int rms_kernel(double *arena, const Sums *at, const Sums *sizes) noexcept nogil:
    return window_sums(arena, at, sizes, True)


cdef struct Extreme:
    int32_t u, y, values
    int32_t steps               # step in which each value arrived
    int32_t queue               # for each element: start of the queue, its length, step of the last NaN
    int32_t now

EXTREME = items((<Extreme *>ITEMS)[0], "u[...] y[...] values[...] steps[...] queue[...]")


cdef inline int window_extreme(double *arena, const Extreme *at, const Extreme *sizes, double sign) noexcept nogil:
    cdef int width = sizes.y
    cdef int length = sizes.values // width
    cdef double now = arena[at.now]
    cdef double *values = arena + at.values
    cdef double *steps = arena + at.steps
    cdef double *queue = arena + at.queue
    cdef double u
    cdef int i, first, count, last
    for i in range(width):
        u = finite(arena[at.u + i])
        first, count = <int>queue[0], <int>queue[1]
        if count > 0 and steps[first] <= now - length:          # 1. Drop the oldest when it leaves the window.
            first = first + 1 if first + 1 < length else 0
            count -= 1
        if u != u:
            queue[2] = now
        else:
            while count > 0:                                    # 2. Drop those that can no longer be the extreme.
                last = first + count - 1
                if last >= length:
                    last -= length
                if sign * values[last] > sign * u:
                    break
                count -= 1
            last = first + count
            if last >= length:
                last -= length
            values[last] = u
            steps[last] = now
            count += 1
        queue[0], queue[1] = first, count
        arena[at.y + i] = NAN if queue[2] > now - length else values[first]
        values += length
        steps += length
        queue += 3
    arena[at.now] = now + 1.0
    return OK


cdef int maximum_kernel(double *arena, const Extreme *at, const Extreme *sizes) noexcept nogil:
    return window_extreme(arena, at, sizes, 1.0)


cdef int minimum_kernel(double *arena, const Extreme *at, const Extreme *sizes) noexcept nogil:
    return window_extreme(arena, at, sizes, -1.0)


average = export(<kernel_t>average_kernel, SUMS)
rms = export(<kernel_t>rms_kernel, SUMS)
maximum = export(<kernel_t>maximum_kernel, EXTREME)
minimum = export(<kernel_t>minimum_kernel, EXTREME)
