"""Monitor of a joint's acceleration against `max_acceleration`, the bound that a drive's control law depends on.

Principle
    1. Each new reply is compared with earlier ones, back to max(3 replies, 15 ms): |ω(k) − ω(k−n)| > a Δt + margin for
       any of them exceeds the bound. Short spans detect an impact with its first reply, the long span detects smaller
       excesses despite noise.
    2. Δt is the difference of the replies' times, and at least n periods, since replies that a bus delayed arrive close
       together.
    3. The margin is two codes plus the noise of this drive's velocity, measured during calm motion: 4.1 times the mean
       magnitude of second differences, which is 8 σ of white noise, and at most 1.2 rad/s, its initial value.
    4. Above the bound, the share of stiffness and damping becomes 0 in the same tick, which leaves the torque command.
       After no span exceeds the bound, which takes the length of the window, the share returns over 100 ms.
    5. Time above the bound accumulates and calm time subtracts a quarter of its length: more than 50 ms, and more than
       6 periods, is a fault. One impact exceeds the bound for one window, 15 ms at 200 Hz and more.
A velocity of NaN exceeds the bound.
"""

from libc.math cimport fabs, fmax, fmin
from libc.stdint cimport int64_t

from cext.safety.thresholds cimport (
    ACCELERATION_FAULT, ACCELERATION_FAULT_PERIODS, ACCELERATION_GAINS_RETURN, ACCELERATION_NOISE_LIMIT,
    ACCELERATION_WINDOW,
    ACCELERATION_WINDOW_REPLIES,
)

cdef enum:
    REPLIES = 64                        # kept; a power of two: above 4 kHz the window is shorter than 15 ms
    NOISE_REPLIES = 64                  # memory of the mean of second differences
    NOISE_PRIOR = 4                     # replies, weight of its initial value
    NOISE_FACTOR = 410                  # %, margin over that mean
    CALM = 4                            # s of calm that cancel one second above the bound

cdef struct Acceleration:
    double bound                        # rad/s²
    double codes                        # rad/s: two codes
    int64_t times[REPLIES]              # ns
    double velocities[REPLIES]          # rad/s
    int64_t count                       # number of replies
    double noise                        # rad/s, mean magnitude of second differences
    double beyond                       # s above the bound, less the calm
    double share                        # permitted share of stiffness and damping
    double worst                        # rad/s², largest over a span above the bound, less its margin


cdef inline void forget_acceleration(Acceleration *a) noexcept nogil:
    a.count = 0
    a.noise = 1e-3 * ACCELERATION_NOISE_LIMIT / (1e-2 * NOISE_FACTOR)
    a.beyond = a.worst = 0.0
    a.share = 1.0


cdef inline double velocity_noise(const Acceleration *a) noexcept nogil:
    """Return the margin for the noise of the velocity, in rad/s."""
    return fmin(1e-2 * NOISE_FACTOR * a.noise, 1e-3 * ACCELERATION_NOISE_LIMIT)


cdef inline bint is_beyond(Acceleration *a, int64_t time, double velocity, double period) noexcept nogil:
    """Store a new reply, and return whether it exceeds the bound."""
    cdef double margin = a.codes + velocity_noise(a)
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
        second = velocity - 2.0 * a.velocities[(a.count - 1) & (REPLIES - 1)] + a.velocities[(a.count - 2) & (REPLIES
            - 1)]
        a.noise += (fabs(second) - a.noise) / <double>min(a.count + NOISE_PRIOR, NOISE_REPLIES)
    place = a.count & (REPLIES - 1)
    a.times[place], a.velocities[place] = time, velocity
    a.count += 1
    return found


cdef inline bint allow_gains(Acceleration *a, bint beyond, bint commanded, double elapsed,
        double period) noexcept nogil:
    """Set the share of stiffness and damping. Returns whether the excess has lasted long enough for a fault.

    commanded : whether stiffness or damping is commanded, since nothing else depends on the bound
    elapsed : s since the previous reply
    """
    if beyond:
        a.share = 0.0
        a.beyond += elapsed if commanded else 0.0
    else:
        a.share = fmin(1.0, a.share + elapsed / (1e-9 * ACCELERATION_GAINS_RETURN))
        a.beyond = fmax(0.0, a.beyond - elapsed / CALM)
    return a.beyond > fmax(1e-9 * ACCELERATION_FAULT, ACCELERATION_FAULT_PERIODS * period) + 1e-9
