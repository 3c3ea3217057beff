"""Monitor of the motion and torque of one drive, at the joint. Each rule is checked once per new reply.

    implausible     position, velocity or torque is NaN: a fault. So is a temperature that is infinite, or at or below
                    -40 °C, which is outside the use of a wearable robot and typical of a broken sensor; NaN is the
                    temperature of a drive without a sensor
    position jump   cext/safety/jump_watch.pxd: torque command only, at once; a fault in the next tick
    over-travel     more than 0.05 rad outside the joint's `range`: a fault
    overspeed       faster than `max_velocity` in 3 replies in a row: a fault
    excess torque   measured torque exceeds the limit plus the drive's stated accuracy in 4 replies in a row and for 20
                    ms: a fault
    acceleration    cext/safety/acceleration_watch.pxd: torque command only, at once; a fault if it persists
    not following   over 60 ms (exponential means) the sent law exceeds 10 % of the rated torque, and less than 20 % of
                    it is measured, for the law of this reply and of the previous one, in 4 replies in a row and for 50
                    ms: a fault
    uncommanded     cext/safety/torque_watch.pxd: torque without a command: a fault
    scale           cext/safety/scale_watch.pxd: velocity against position, torque against the sent law: a fault

The law is K (θ₀ − θ) + B (ω₀ − ω) + τ of the last frame, with the newest reply; for a current command, its torque.
All rules hold from the first reply of a drive on, with two exceptions. Until arming enables it, the operator may move the
joint by hand: a position outside its range prevents arming, but is not a fault. Before the first tick no stiffness or damping
is sent, so that no acceleration is a fault.
"""

from libc.math cimport NAN, fabs, isfinite, isinf
from libc.stdint cimport int64_t

from cext.abi cimport AUTHORITY, OK
from cext.status cimport (
    BEYOND_ACCELERATION, BEYOND_TORQUE, IMPLAUSIBLE, NOT_FOLLOWING, OVERSPEED, OVER_TRAVEL, POSITION_JUMP,
    SCALE_MISMATCH, UNCOMMANDED_TORQUE,
)
from cext.safety.acceleration_watch cimport Acceleration, allow_gains, forget_acceleration, is_beyond, velocity_noise
from cext.safety.jump_watch cimport Jump, forget_jump, is_jump
from cext.safety.scale_watch cimport ENDS, Scale, Way, compare, follow, forget_scale
from cext.safety.thresholds cimport (
    EXCESS_TORQUE, EXCESS_TORQUE_REPLIES, FOLLOWING_COMMANDED, FOLLOWING_FAULT, FOLLOWING_FAULT_REPLIES,
    FOLLOWING_MEAN, FOLLOWING_MEASURED,
    OVERSPEED_REPLIES, TEMPERATURE_MINIMUM, TRAVEL_MARGIN,
)
from cext.safety.torque_watch cimport Uncommanded, is_uncommanded

cdef enum:
    REPLY_STEP_LIMIT = 50000000         # ns between two replies that counts

cdef enum: # quantity of a fault
    NOTHING, TEMPERATURE, POSITION, VELOCITY, TORQUE

cdef struct Motion:
    int position, velocity, torque      # slots of outputs; -1: none, and nothing is checked
    int stiffness, damping              # slots of inputs; -1: none
    int law                             # slot of the first of five values of the last frame; -1: none
    int current                         # slot of a sent current; -1: none
    double current_scale                # N·m of an A
    int gains                           # slot of the permitted share of stiffness and damping; -1: none
    double low, high                    # rad
    double fastest                      # rad/s
    double limit, accuracy, rated       # N·m
    double offset                       # rad
    double position_end, velocity_end   # rad, rad/s, ends of the encoded range, infinite for none
    bint early                          # before the first tick
    bint free                           # arming has not enabled the drive yet
    int64_t reply_time                       # ns, time of the newest checked reply; -1: none
    Uncommanded uncommanded
    Acceleration acceleration
    Jump jump
    bint jumped                         # a reply has jumped, and ends the run in the next tick
    Scale velocity_scale, torque_scale
    Way way
    int fast, excessive, idle           # replies in a row
    double excess_time, idle_time       # s
    double asked, given, given_before   # N·m, means
    double wanted                       # N·m, the law at the previous reply
    bint beyond                         # this reply exceeds the bound of acceleration, and gains are commanded
    int about                           # quantity of the newest fault
    double value, bound                 # its value and bound


cdef inline void forget_motion(Motion *m) noexcept nogil:
    forget_acceleration(&m.acceleration)
    forget_jump(&m.jump)
    forget_scale(&m.velocity_scale)
    forget_scale(&m.torque_scale)
    m.way.runs = m.beyond = m.jumped = False
    m.reply_time = -1
    m.fast = m.excessive = m.idle = 0
    m.excess_time = m.idle_time = m.asked = m.given = m.given_before = m.wanted = 0.0


cdef inline int blame(Motion *m, int status, int about, double value, double bound) noexcept nogil:
    m.about, m.value, m.bound = about, value, bound
    return status


cdef inline int judge_values(Motion *m, const double *arena, double temperature) noexcept nogil:
    """Check that the measurements are plausible."""
    if isinf(temperature) or temperature <= TEMPERATURE_MINIMUM:
        return blame(m, IMPLAUSIBLE, TEMPERATURE, temperature, TEMPERATURE_MINIMUM)
    if m.position >= 0 and not isfinite(arena[m.position]):
        return blame(m, IMPLAUSIBLE, POSITION, arena[m.position], NAN)
    if m.velocity >= 0 and not isfinite(arena[m.velocity]):
        return blame(m, IMPLAUSIBLE, VELOCITY, arena[m.velocity], NAN)
    if not isfinite(arena[m.torque]):
        return blame(m, IMPLAUSIBLE, TORQUE, arena[m.torque], NAN)
    return OK


cdef inline bint is_stiff(const double *arena, int stiffness, int damping) noexcept nogil:
    """Return whether stiffness or damping is commanded. stiffness, damping : slots, -1 for none"""
    return stiffness >= 0 and (arena[stiffness] > 0.0 or arena[damping] > 0.0)


cdef inline bint stiff(const Motion *m, const double *arena) noexcept nogil:
    return is_stiff(arena, m.stiffness, m.damping)


cdef inline int judge_jump(
        Motion *m, double *arena, int64_t reply_time, double transit, bint commanded) noexcept nogil:
    """Check the change of the angle. Returns OK or the fault: at once, or one tick after stiffness and damping.

    transit : s, from the command to the newest reply
    commanded : whether a tick with commands follows
    """
    if m.position < 0 or m.velocity < 0 or reply_time < 0:
        return OK
    if m.jumped:
        return POSITION_JUMP
    if not is_jump(&m.jump, reply_time, arena[m.position], arena[m.velocity], velocity_noise(&m.acceleration), transit):
        return OK
    blame(m, POSITION_JUMP, POSITION, m.jump.change, m.jump.bound)
    m.jumped = commanded and stiff(m, arena)
    return OK if m.jumped else POSITION_JUMP


cdef inline int judge_motion(
        Motion *m, double *arena, int64_t reply_time, double period, double left, bint late) noexcept nogil:
    """Check the motion. Returns OK or the fault.

    reply_time : ns, of the newest reply
    left : fraction of the limit when the last command was encoded
    late : whether the transit of replies does not permit stiffness and damping
    """
    cdef double position, velocity, elapsed, wanted, limit
    cdef int64_t step = reply_time - m.reply_time
    cdef int status
    if m.position < 0 or m.velocity < 0 or step <= 0:
        return OK
    if m.reply_time < 0 or step > REPLY_STEP_LIMIT:
        step = REPLY_STEP_LIMIT if m.reply_time >= 0 else 0
    m.reply_time = reply_time
    elapsed = 1e-9 * step
    position, velocity = arena[m.position], arena[m.velocity]
    status = judge_acceleration(m, arena, reply_time, velocity, elapsed, period, late)
    if status != OK:
        return status
    if not m.free and not m.low - 1e-3 * TRAVEL_MARGIN <= position <= m.high + 1e-3 * TRAVEL_MARGIN:
        return blame(m, OVER_TRAVEL, POSITION, position, m.low if position < m.low else m.high)
    m.fast = m.fast + 1 if fabs(velocity) > m.fastest else 0
    if m.fast >= OVERSPEED_REPLIES:
        return blame(m, OVERSPEED, VELOCITY, velocity, m.fastest)
    status = judge_torque(m, arena[m.torque], left * m.limit, elapsed)
    if status != OK:
        return status
    status = judge_velocity_scale(m, reply_time, position, velocity)
    if status != OK:
        return status
    if m.early or arena[AUTHORITY] == 0.0:                      # no command is sent
        m.asked = m.given = m.given_before = m.wanted = 0.0
        return judge_uncommanded(m, 0.0, arena[m.torque], reply_time)
    if m.law < 0 and m.current < 0:
        return OK
    if m.law >= 0:
        wanted = arena[m.law + 2] * (arena[m.law] - position) + arena[m.law + 3] * (arena[m.law + 1]
            - velocity) + arena[m.law + 4]
    else:
        wanted = m.current_scale * arena[m.current]
    status = judge_uncommanded(m, wanted, arena[m.torque], reply_time)
    return status if status != OK else judge_following(m, wanted, arena[m.torque], elapsed)


cdef inline int judge_uncommanded(Motion *m, double wanted, double torque, int64_t reply_time) noexcept nogil:
    """Check that no torque is measured while none is commanded. wanted : N·m, the law that was sent"""
    return blame(m, UNCOMMANDED_TORQUE, TORQUE, torque, 0.0) if is_uncommanded(
        &m.uncommanded, wanted, torque, m.rated, reply_time) else OK


cdef inline int judge_acceleration(
        Motion *m, double *arena, int64_t reply_time, double velocity, double elapsed, double period,
        bint late) noexcept nogil:
    cdef bint commanded, persists
    m.beyond = False
    if m.gains < 0:
        return OK
    commanded = not m.early and stiff(m, arena) and not late        # else nothing depends on the bound
    m.beyond = is_beyond(&m.acceleration, reply_time, velocity, period)
    persists = allow_gains(&m.acceleration, m.beyond, commanded, elapsed, period)
    m.beyond &= commanded
    if m.jumped or late:
        m.acceleration.share = 0.0
    arena[m.gains] = m.acceleration.share
    return blame(m, BEYOND_ACCELERATION, VELOCITY, m.acceleration.worst,
        m.acceleration.bound) if persists and commanded else OK


cdef inline int judge_torque(Motion *m, double torque, double limit, double elapsed) noexcept nogil:
    """Check the measured torque against the limit."""
    if fabs(torque) <= limit + m.accuracy:
        m.excessive, m.excess_time = 0, 0.0
        return OK
    m.excessive += 1
    m.excess_time += elapsed
    if m.excessive >= EXCESS_TORQUE_REPLIES and m.excess_time >= 1e-9 * EXCESS_TORQUE - 1e-9:
        return blame(m, BEYOND_TORQUE, TORQUE, torque, limit)
    return OK


cdef inline int judge_velocity_scale(Motion *m, int64_t reply_time, double position, double velocity) noexcept nogil:
    cdef bint counts = (fabs(position + m.offset) < 1e-3 * ENDS * m.position_end
                        and fabs(velocity) < 1e-3 * ENDS * m.velocity_end)
    cdef double scale = follow(&m.way, &m.velocity_scale, reply_time, position, velocity, m.position_end, counts)
    return OK if scale == 0.0 else blame(m, SCALE_MISMATCH, VELOCITY, scale, 1.0)


cdef inline int judge_following(Motion *m, double wanted, double torque, double elapsed) noexcept nogil:
    """Check the measured torque against the sent law."""
    cdef double share = elapsed / (1e-9 * FOLLOWING_MEAN + elapsed)
    cdef double most = 1e-2 * FOLLOWING_COMMANDED * m.rated
    cdef double scale = 0.0
    m.asked += share * (fabs(wanted) - m.asked)
    m.given += share * ((torque if wanted > 0.0 else -torque) - m.given)
    m.given_before += share * ((torque if m.wanted > 0.0 else -torque) - m.given_before)
    m.wanted = wanted
    if m.asked > most and max(m.given, m.given_before) < 1e-2 * FOLLOWING_MEASURED * m.asked:
        m.idle += 1
        m.idle_time += elapsed
    else:
        m.idle, m.idle_time = 0, 0.0
    if m.idle >= FOLLOWING_FAULT_REPLIES and m.idle_time >= 1e-9 * FOLLOWING_FAULT - 1e-9:
        return blame(m, NOT_FOLLOWING, TORQUE, max(m.given, m.given_before), m.asked)
    if max(fabs(wanted), fabs(torque)) > most and fabs(wanted) <= 0.5 * m.rated:
        scale = compare(&m.torque_scale, wanted, torque, elapsed)
    return OK if scale == 0.0 else blame(m, SCALE_MISMATCH, TORQUE, scale, 1.0)
