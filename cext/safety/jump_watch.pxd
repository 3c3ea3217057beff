"""Monitor of a joint's angle for a change that cannot be motion: of an encoder, of another drive, or after a restart.

Principle
    1. Between two replies, the angle changes by (ω1 + ω2) Δt / 2 if the velocity changes evenly. A velocity that
       changes otherwise adds at most |ω2 - ω1| Δt / 2, and an excursion of it, up to A and back, A Δt² / 4. A is
       JUMP_ACCELERATION times `max_acceleration`: this monitor is for what cannot be motion. Beyond JUMP_IMPACT, the
       excursion grows with `max_acceleration` only, since nothing accelerates longer with A.
    2. Added are two codes of the position, the noise of the velocity, and for the time of a sample, which is between
       command and reply, the speed times the transit. An interval below JUMP_INTERVAL counts as that.
    3. A velocity that a drive filters lags behind the angle. For replies that are close together, a change is also
       explained by the change before it, within an acceleration of A / 2.
    4. At an end of its range the position is constant while the joint moves, so it may lack the whole motion; at an end
       of the range of the velocity nothing is compared.
"""

from libc.math cimport NAN, fabs, fmax, fmin, isfinite
from libc.stdint cimport int64_t

from cext.safety.thresholds cimport (
    JUMP_ACCELERATION, JUMP_ACCELERATION_MINIMUM, JUMP_IMPACT, JUMP_INTERVAL, JUMP_SUSTAINED,
)

cdef enum:
    CLOSE = 6000000                     # ns between replies that are close together
    END_CODES = 3                       # of position, and of 1000 of the velocity's range: at the end of it

cdef struct Jump:
    double step                         # rad, one code of position
    double position_end, velocity_end   # rad, rad/s, ends of the encoded range, without the offset; infinite for none
    double offset                       # rad
    double sustained, impact            # rad/s²
    int64_t time                        # ns, time of the newest reply; -1: none
    double position, velocity           # values in it
    double transit                      # s, of it
    double rate, elapsed                # rad/s and s, from the reply before to it; NaN: none
    double change, bound                # rad, newest jump and its bound


cdef inline void set_acceleration(Jump *j, double acceleration) noexcept nogil:
    """Set the bounds. acceleration : rad/s², `max_acceleration`, or infinite if the drive has none"""
    j.sustained = acceleration if isfinite(acceleration) else JUMP_SUSTAINED
    j.impact = fmax(1e-2 * JUMP_ACCELERATION * j.sustained, JUMP_ACCELERATION_MINIMUM)


cdef inline void forget_jump(Jump *j) noexcept nogil:
    j.time = -1
    j.rate = NAN


cdef inline bint is_at_end(const Jump *j, double position) noexcept nogil:
    """Return whether an angle in rad is at an end of the encoded range, where the joint may be beyond it."""
    return fabs(position + j.offset) > j.position_end - END_CODES * j.step


cdef inline double unexplained(
        const Jump *j, double elapsed, double change, double velocity, double noise, double transit) noexcept nogil:
    """Return the largest change that motion explains if `change` is beyond it, else 0."""
    cdef double span = fmax(elapsed, 1e-9 * JUMP_INTERVAL)
    cdef double speed = fmax(fabs(velocity), fabs(j.velocity))
    cdef double even = 0.5 * (velocity + j.velocity) * elapsed
    cdef double peak = 0.5 * fmin(j.impact * span,
        j.sustained * span + (j.impact - j.sustained) * 1e-9 * JUMP_IMPACT)
    cdef double margin = 2.0 * j.step + speed * fmax(transit, j.transit)
    cdef double bound = margin + (0.5 * fabs(velocity - j.velocity) + noise) * span + 0.5 * peak * span
    if fabs(change) <= 2.0 * j.step:
        return 0.0                              # an angle that is held has not jumped
    if not speed < j.velocity_end * (1.0 - 1e-3 * END_CODES):
        return 0.0
    if is_at_end(j, j.position + change) or is_at_end(j, j.position):
        bound += speed * elapsed
    if j.rate != j.rate:
        bound += 2.0 * speed * span             # the first change: a scale of the velocity may be wrong, and its sign
    if fabs(change - even) <= bound:
        return 0.0
    if fmax(elapsed, j.elapsed) <= 1e-9 * CLOSE and fabs(change - j.rate * elapsed) <= (
            0.5 * j.impact * span * span + margin + 2.0 * j.step * elapsed / j.elapsed):
        return 0.0
    return bound + fabs(even)


cdef inline bint is_jump(
        Jump *j, int64_t time, double position, double velocity, double noise, double transit) noexcept nogil:
    """Store a reply, and return whether its angle cannot be reached by motion from that of the reply before.

    noise : rad/s, of the velocity
    transit : s, from the command to this reply
    """
    cdef double elapsed = 1e-9 * (time - j.time)
    cdef double change = position - j.position
    cdef double bound = 0.0
    if time == j.time:
        return False
    if j.time >= 0 and elapsed > 0.0:
        bound = unexplained(j, elapsed, change, velocity, noise, transit)
        j.rate, j.elapsed = change / elapsed, elapsed
    if bound > 0.0:
        j.change, j.bound = change, bound
        j.rate = NAN
    j.time, j.position, j.velocity, j.transit = time, position, velocity, transit
    return bound > 0.0
