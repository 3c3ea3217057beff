"""Acceleration of a joint against the bound on which a drive's law rests: `max_acceleration`.

Principle
    1. Each new reply is compared with those before it, back to max(3 replies, 15 ms): |ω(k) − ω(k−n)| > a Δt + margin for any of them is
       beyond the bound. Short spans find an impact in the first reply that shows it, the long one finds less through the noise.
    2. Δt is the difference of the replies' times, and no less than n periods: replies that a bus has held up come close together.
    3. The margin is two codes and the noise of this drive's velocity, measured where the motion is calm: 4.1 times the mean magnitude of
       second differences, which is 8 σ of white noise, and 1.2 rad/s at most; that is where it starts.
    4. Beyond it the share of stiffness and damping is 0 in the same tick: torque alone. Once no span is beyond it any more, which
       takes the length of the window, the share returns over 100 ms.
    5. Time beyond the bound adds up, calm takes a quarter of its own length away: more than 50 ms, and more than 6 periods, is a fault.
       One impact is beyond the bound for one window, 15 ms at 200 Hz and more.
A velocity that is not a number is beyond the bound.
"""

from libc.math cimport fabs, fmax, fmin
from libc.stdint cimport int64_t

from cext.safety.thresholds cimport (
    ACCELERATION_FAULT, ACCELERATION_FAULT_PERIODS, ACCELERATION_GAINS_RETURN, ACCELERATION_NOISE_LIMIT, ACCELERATION_WINDOW,
    ACCELERATION_WINDOW_REPLIES,
)

cdef enum:
    REPLIES = 64                        # kept; a power of two: above 4 kHz the window is shorter than 15 ms
    NOISE_REPLIES = 64                  # memory of the mean of second differences
    NOISE_PRIOR = 4                     # replies, for which its value at the start counts
    NOISE_FACTOR = 410                  # %, margin over that mean
    CALM = 4                            # s of calm that take one second beyond the bound away

cdef struct Acceleration:
    double bound                        # rad/s²
    double codes                        # rad/s: two codes
    int64_t times[REPLIES]              # ns
    double velocities[REPLIES]          # rad/s
    int64_t count                       # of replies
    double noise                        # rad/s, mean magnitude of second differences
    double beyond                       # s beyond the bound, less the calm
    double share                        # of stiffness and damping that is allowed
    double worst                        # rad/s², largest over the span that was beyond the bound, less its margin


cdef inline void forget_acceleration(Acceleration *a) noexcept nogil:
    a.count = 0
    a.noise = 1e-3 * ACCELERATION_NOISE_LIMIT / (1e-2 * NOISE_FACTOR)
    a.beyond = a.worst = 0.0
    a.share = 1.0


cdef inline bint is_beyond(Acceleration *a, int64_t time, double velocity, double period) noexcept nogil:
    """Whether a new reply is beyond the bound; keeps it."""
    cdef double margin = a.codes + fmin(1e-2 * NOISE_FACTOR * a.noise, 1e-3 * ACCELERATION_NOISE_LIMIT)
    cdef int most = <int>min(a.count, REPLIES - 1)
    cdef bint found = False
    cdef double elapsed, change, second
    cdef int back, place
    for back in range(1, most + 1):
        place = (a.count - back) & (REPLIES - 1)
        elapsed = fmax(1e-9 * (time - a.times[place]), back * period)
        change = fabs(velocity - a.velocities[place])
        if not change <= a.bound * elapsed + margin:
            found = True
            a.worst = fmax(a.worst, (change - margin) / elapsed)
        if back >= ACCELERATION_WINDOW_REPLIES and elapsed >= 1e-9 * ACCELERATION_WINDOW - 1e-7:
            break
    if most >= 2 and not found:
        second = velocity - 2.0 * a.velocities[(a.count - 1) & (REPLIES - 1)] + a.velocities[(a.count - 2) & (REPLIES - 1)]
        a.noise += (fabs(second) - a.noise) / <double>min(a.count + NOISE_PRIOR, NOISE_REPLIES)
    place = a.count & (REPLIES - 1)
    a.times[place], a.velocities[place] = time, velocity
    a.count += 1
    return found


cdef inline bint allow_gains(Acceleration *a, bint beyond, bint commanded, double elapsed, double period) noexcept nogil:
    """Set the share of stiffness and damping. Whether it was beyond the bound for so long that it is a fault.

    commanded : whether stiffness or damping is: without them nothing rests on the bound
    elapsed : s since the reply before
    """
    if beyond:
        a.share = 0.0
        a.beyond += elapsed if commanded else 0.0
    else:
        a.share = fmin(1.0, a.share + elapsed / (1e-9 * ACCELERATION_GAINS_RETURN))
        a.beyond = fmax(0.0, a.beyond - elapsed / CALM)
    return a.beyond > fmax(1e-9 * ACCELERATION_FAULT, ACCELERATION_FAULT_PERIODS * period) + 1e-9
