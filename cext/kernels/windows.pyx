# cython: freethreading_compatible=True
"""Statistics of the last N inputs, in fixed memory and without drift.

Sums. Principle: 1. a ring holds the inputs; 2. the running sum takes each new one and gives back the one that leaves; 3. beside it
grows a fresh sum, of the inputs since the ring last began anew; whenever the ring is full once more, the fresh sum is that of the whole
window, and replaces the running one; 4. both keep what rounding has lost in a second double; 5. what is not finite is counted, not
added, so that it leaves no trace.

Extremes. A monotonic queue: an input that a later and larger one hides can never be the maximum again, and is dropped.
"""

from libc.math cimport NAN, sqrt
from libc.stdint cimport int32_t

from cext.abi cimport OK, export
from cext.kernels.limits cimport finite, is_finite
from cext.kernels.compensated_sum cimport FRESH, RUNNING, RUNNING_REST, add, begin_anew

cdef enum: # of MovingAverage and MovingRMS
    U, Y, WINDOW, SAMPLES, SUMS, PLACE

cdef enum: # in SUMS, for each element, behind the two sums
    STRANGE = 4                 # how many inputs in the window are not finite
    SUMS_PER_ELEMENT


cdef inline int window_sums(double *arena, const int32_t *slots, const int32_t *sizes, bint squares) noexcept nogil:
    cdef int width = sizes[Y]
    cdef int length = sizes[SAMPLES] // width
    cdef int place = <int>arena[slots[PLACE]]
    cdef int count = <int>arena[slots[PLACE] + 1]
    cdef bint full = count == length
    cdef double *samples = arena + slots[SAMPLES] + place * width
    cdef double *sums = arena + slots[SUMS]
    cdef double x
    cdef int i
    if not full:
        count += 1
    for i in range(width):
        x = arena[slots[U] + i]
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
        arena[slots[Y] + i] = NAN if sums[STRANGE] > 0.0 else x
        sums += SUMS_PER_ELEMENT
    arena[slots[PLACE]] = 0.0 if place + 1 == length else place + 1
    arena[slots[PLACE] + 1] = count
    return OK


cdef int average_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return window_sums(arena, slots, sizes, False)


cdef int rms_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return window_sums(arena, slots, sizes, True)


cdef enum: # of MovingMaximum and MovingMinimum
    VALUES = 3                  # u, y, window before it
    STEPS                       # when each value came
    QUEUE                       # for each element: where the queue begins, how long it is, step of the last NaN
    NOW


cdef inline int window_extreme(double *arena, const int32_t *slots, const int32_t *sizes, double sign) noexcept nogil:
    cdef int width = sizes[1]
    cdef int length = sizes[VALUES] // width
    cdef double now = arena[slots[NOW]]
    cdef double *values = arena + slots[VALUES]
    cdef double *steps = arena + slots[STEPS]
    cdef double *queue = arena + slots[QUEUE]
    cdef double u
    cdef int i, first, count, last
    for i in range(width):
        u = finite(arena[slots[0] + i])
        first, count = <int>queue[0], <int>queue[1]
        if count > 0 and steps[first] <= now - length:          # 1. The oldest leaves the window.
            first = first + 1 if first + 1 < length else 0
            count -= 1
        if u != u:
            queue[2] = now
        else:
            while count > 0:                                    # 2. What the new one hides is dropped.
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
        arena[slots[1] + i] = NAN if queue[2] > now - length else values[first]
        values += length
        steps += length
        queue += 3
    arena[slots[NOW]] = now + 1.0
    return OK


cdef int maximum_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return window_extreme(arena, slots, sizes, 1.0)


cdef int minimum_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    return window_extreme(arena, slots, sizes, -1.0)


average = export(average_kernel)
rms = export(rms_kernel)
maximum = export(maximum_kernel)
minimum = export(minimum_kernel)
