"""The clock of a device, mapped to the computer's: when a sample was taken, from when it says so and when it came.

A sample comes later than it was taken, by what the way took, and now and then by much more; never earlier. So the least difference of a while
is the one to trust. The least of each second is kept, a line is drawn through the newest of them, and its slope is how much faster the
computer's clock goes than the device's. (Paxson, "On calibrating measurements of packet transit times", 1998)
"""

from libc.math cimport floor, isfinite

cdef enum:
    POINTS = 16                 # seconds that the line goes through
    ENOUGH = 4                  # before a slope is told
    LARGEST_JUMP = 1            # s by which a clock may be ahead of what has passed, or stand still, and still be the same clock

cdef struct ClockMap:           # lies in the memory of a block; times in s
    double known                # whether it has begun
    double origin               # of the device's clock
    double newest               # on it, since the origin
    double opened               # when the present second began, on it
    double least                # difference in the present second,
    double least_at             # and when
    double points               # of the line
    double at[POINTS]
    double difference[POINTS]
    double offset               # at the origin
    double slope

cdef struct DeviceClock:        # one whose counter begins anew now and then; times in s
    ClockMap map
    double known                # whether it has told anything
    double value                # that it told last,
    double said                 # with all that its counter has gone round,
    double came                 # when that came
    double moved                # and when it came that it differed from the one before



cdef inline void draw(ClockMap *map) noexcept nogil:
    """The line through the points, least squares."""
    cdef int count = <int>map.points
    cdef int index
    cdef double mean = 0.0
    cdef double level = 0.0
    cdef double across = 0.0
    cdef double square = 0.0
    for index in range(count):
        mean += map.at[index] / count
        level += map.difference[index] / count
    for index in range(count):
        across += (map.at[index] - mean) * (map.difference[index] - level)
        square += (map.at[index] - mean) * (map.at[index] - mean)
    map.slope = across / square if count >= ENOUGH and square > 0.0 else 0.0
    map.offset = level - map.slope * mean
    if count < ENOUGH:
        for index in range(count):
            map.offset = min(map.offset, map.difference[index])


cdef inline double mapped(ClockMap *map, double said, double came) noexcept nogil:
    """When a sample was taken, in s of the computer's clock. said : s, on the device's; came : s, on the computer's"""
    cdef double since = said - map.origin
    cdef double difference = came - since
    cdef double here
    cdef int index
    if map.known == 0.0 or since < map.newest - 1e-3 or since > map.newest + 60.0:     # it was switched on again, or set
        map.known, map.origin, map.newest, map.opened, map.points, map.slope = 1.0, said, 0.0, 0.0, 0.0, 0.0
        map.least = map.offset = came
        map.least_at = 0.0
        return came
    map.newest = max(map.newest, since)
    if difference < map.least:
        map.least, map.least_at = difference, since
    if map.points == 0.0:
        map.offset = map.least
    if since - map.opened >= 1.0:
        if map.points == POINTS:
            for index in range(POINTS - 1):
                map.at[index], map.difference[index] = map.at[index + 1], map.difference[index + 1]
            map.points -= 1.0
        index = <int>map.points
        map.at[index], map.difference[index] = map.least_at, map.least
        map.points += 1.0
        map.opened, map.least, map.least_at = since, difference, since
        draw(map)
    here = since + map.offset + map.slope * since
    return min(here, came)


cdef inline double sampled(DeviceClock *clock, double value, double wrap, double came) noexcept nogil:
    """When a sample was taken, as above, of a counter that begins anew every `wrap` s; 0: it never does.

    How often it has gone round since the last sample, the computer's clock tells. One that is no number, stands still, or has been set says
    nothing: then a sample was taken when it came.
    """
    cdef double step, elapsed, turns
    if not isfinite(value):
        return came
    elapsed, step = came - clock.came, value - clock.value
    if clock.known == 0.0:
        clock.known, clock.said, clock.moved = 1.0, value, came
    else:
        turns = floor((elapsed - step) / wrap + 0.5) if wrap > 0.0 else 0.0
        if step != 0.0 or turns > 0.0:
            clock.moved = came
        step += turns * wrap if turns > 0.0 else 0.0
        clock.said += step
        if not isfinite(clock.said):
            clock.said = value
        if step > elapsed + LARGEST_JUMP or came - clock.moved > LARGEST_JUMP:
            clock.map.known = 0.0
    clock.value, clock.came = value, came
    return mapped(&clock.map, clock.said, came)
