"""Zero of a drive at its present position: when it may be set, and what confirms it.

Principle
    1. The zero is set only while no torque is let through: for ZERO_REST, the drive was commanded zero torque and the
       position stayed within ZERO_BAND. A request at any other time is refused.
    2. From the frame to the end of the zeroing, the drive gets zero torque, whatever its block commands. The commands
       then fade in, since the angle of the joint has jumped.
    3. A reply with a position within ZERO_BAND of zero confirms it, unless the joint has left the earlier position
       without a jump: then the frame is lost, and the joint passes through zero. While the drive replies with its
       earlier position, the frame is lost, and is repeated every ZERO_RETRY. Some drives are silent for a second after
       the frame.
    4. After ZERO_LIMIT, a drive that replies with its earlier position keeps its zero. With any other position, the
       angle of the joint is unknown, which is a fault.
"""

from libc.math cimport NAN, fabs
from libc.stdint cimport int64_t

from cext.safety.thresholds cimport ZERO_BAND, ZERO_LIMIT, ZERO_REST, ZERO_RETRY

cdef enum:                      # results of `judge_zero`
    ZERO_WAITS                  # for a reply, or until the limit
    ZERO_LOST                   # the frame has had no effect: send it again
    ZERO_SET                    # confirmed
    ZERO_KEPT                   # the drive keeps its earlier zero
    ZERO_UNKNOWN                # the drive replies with neither its earlier position nor zero

cdef struct Zeroing:
    int position                # slot of the joint's position; -1: the zero cannot be set
    int request                 # slot of the input; -1: only during arming
    int law                     # slot of the five values of the last frame; -1: none
    int current                 # slot of a sent current; -1: none
    double offset               # rad, position of the drive at the zero of the joint
    double torque_code          # N·m, largest torque of a frame that encodes zero torque
    bint at_arming
    bint due                    # to be set before arming is complete
    bint requested              # input in the previous tick
    bint runs                   # from the frame to the end of the zeroing
    int64_t began, sent         # ns, times of the first and the newest frame
    int64_t asked_at            # ns, time of the newest reply when the frame was sent
    double before               # rad, position at the first frame
    bint moved                  # since the newest frame, a reply was off that position, and nearer to it than to zero
    int64_t reply_time          # ns, time of the newest reply
    double held                 # rad, position since `still_since`
    int64_t still_since         # ns
    int64_t idle_since          # ns, since when zero torque has been commanded
    int64_t set, refused        # number of zeros that were set, and of requests that were refused


cdef inline void forget_zero(Zeroing *z) noexcept nogil:
    """Return to the state before arming."""
    z.due, z.requested, z.runs = z.at_arming, True, False
    z.reply_time = -1
    z.set = z.refused = 0
    begin_rest(z, 0)


cdef inline void begin_rest(Zeroing *z, int64_t now) noexcept nogil:
    """Start the time of rest at `now`, in ns."""
    z.held = NAN
    z.still_since = z.idle_since = now


cdef inline void note_position(Zeroing *z, const double *arena, int64_t reply_time, int64_t now) noexcept nogil:
    """Note a new reply. reply_time : ns, of the newest one"""
    if reply_time == z.reply_time:
        return
    z.reply_time = reply_time
    if z.runs:
        z.moved |= 1e-3 * ZERO_BAND < fabs(arena[z.position] - z.before) < fabs(arena[z.position] + z.offset)
    if not fabs(arena[z.position] - z.held) <= 1e-3 * ZERO_BAND:
        z.held, z.still_since = arena[z.position], now


cdef inline void note_command(Zeroing *z, const double *arena, int64_t now) noexcept nogil:
    """Note the command of a tick, after it was encoded."""
    cdef bint idle
    if z.law >= 0:
        idle = (arena[z.law + 2] == 0.0 and arena[z.law + 3] == 0.0 and fabs(arena[z.law + 4]) <= z.torque_code)
    else:
        idle = z.current >= 0 and arena[z.current] == 0.0
    if not idle:
        z.idle_since = now


cdef inline bint may_be_zeroed(const Zeroing *z, int64_t now) noexcept nogil:
    return not z.held != z.held and now - max(z.still_since, z.idle_since) >= ZERO_REST


cdef inline void begin_zero(Zeroing *z, const double *arena, int64_t now) noexcept nogil:
    """Note that the frame is sent now, for the first time."""
    z.runs, z.began, z.before = True, now, arena[z.position]
    repeat_zero(z, now)


cdef inline void repeat_zero(Zeroing *z, int64_t now) noexcept nogil:
    z.sent, z.asked_at, z.moved = now, z.reply_time, False


cdef inline int judge_zero(const Zeroing *z, const double *arena, int64_t now) noexcept nogil:
    """Return one of the results above, for a zeroing that runs."""
    cdef double position = arena[z.position]
    cdef bint unchanged = fabs(position - z.before) <= 1e-3 * ZERO_BAND
    if z.reply_time != z.asked_at and not z.moved and fabs(position + z.offset) <= 1e-3 * ZERO_BAND:
        return ZERO_SET
    if now - z.began >= ZERO_LIMIT:
        return ZERO_KEPT if unchanged else ZERO_UNKNOWN
    return ZERO_LOST if z.reply_time != z.asked_at and unchanged and now - z.sent >= ZERO_RETRY else ZERO_WAITS
