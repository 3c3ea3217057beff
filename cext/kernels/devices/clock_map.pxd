"""Map from a device's clock to the computer's: sampling time from the sample's time stamp and its arrival time.

A sample arrives after it was taken, by the transit time, which is occasionally much longer. The minimum of the
difference over a while is therefore close to the true offset. The minimum of each second is kept, and a line fitted
through the newest ones; its slope is the drift of the computer's clock relative to the device's.
(Paxson, "On calibrating measurements of packet transit times", 1998)
"""

from libc.math cimport floor, isfinite

cdef enum:
    POINTS = 16                 # seconds that the line covers
    SLOPE_POINTS = 4            # points required for a slope
    # s by which a clock may be ahead, or stand still, before the map starts over
    LARGEST_JUMP = 1

cdef struct ClockMap:           # in the memory of a block; times in s
    double known                # whether it has started
    double origin               # origin of the device's clock
    double newest               # device time since the origin
    double opened               # start of the present second, device time
    double least                # smallest difference in the present second
    double least_at             # its device time
    double points               # number of points of the line
    double at[POINTS]
    double difference[POINTS]
    double offset               # at the origin
    double slope

cdef struct DeviceClock:        # clock with a counter that wraps; times in s
    ClockMap map
    double known                # whether a value has arrived
    double value                # newest value
    double unwrapped            # the same with all wraps of the counter added
    double arrival              # arrival of the newest value
    double moved                # arrival of the newest value that differed from the one before



cdef inline void draw(ClockMap *map) noexcept nogil:
    """Fit the line through the points by least squares."""
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
    map.slope = across / square if count >= SLOPE_POINTS and square > 0.0 else 0.0
    map.offset = level - map.slope * mean
    if count < SLOPE_POINTS:
        for index in range(count):
            map.offset = min(map.offset, map.difference[index])


cdef inline double mapped(ClockMap *map, double stamp, double arrival) noexcept nogil:
    """Return the sampling time, in s of the computer's clock.

    stamp : s, device's clock
    arrival : s, computer's clock
    """
    cdef double since = stamp - map.origin
    cdef double difference = arrival - since
    cdef double here
    cdef int index
    # at the start, after a restart of the device, or after its clock was set
    if map.known == 0.0 or since < map.newest - 1e-3 or since > map.newest + 60.0:
        map.known, map.origin, map.newest, map.opened, map.points, map.slope = 1.0, stamp, 0.0, 0.0, 0.0, 0.0
        map.least = map.offset = arrival
        map.least_at = 0.0
        return arrival
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
    return min(here, arrival)


cdef inline double sampled(DeviceClock *clock, double value, double wrap, double arrival) noexcept nogil:
    """Return the sampling time as `mapped` does, for a counter that wraps every `wrap` s; 0: never.

    The computer's clock gives the number of wraps since the last sample. If the value is not finite, stands still, or
    has been set, the arrival is returned.
    """
    cdef double step, elapsed, turns
    if not isfinite(value):
        return arrival
    elapsed, step = arrival - clock.arrival, value - clock.value
    if clock.known == 0.0:
        clock.known, clock.unwrapped, clock.moved = 1.0, value, arrival
    else:
        turns = floor((elapsed - step) / wrap + 0.5) if wrap > 0.0 else 0.0
        if step != 0.0 or turns > 0.0:
            clock.moved = arrival
        step += turns * wrap if turns > 0.0 else 0.0
        clock.unwrapped += step
        if not isfinite(clock.unwrapped):
            clock.unwrapped = value
        if step > elapsed + LARGEST_JUMP or arrival - clock.moved > LARGEST_JUMP:
            clock.map.known = 0.0
    clock.value, clock.arrival = value, arrival
    return mapped(&clock.map, clock.unwrapped, arrival)
