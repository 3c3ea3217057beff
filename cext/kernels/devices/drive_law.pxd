"""Torque limit of the law that a drive closes between two frames, τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff.

The feedback has an age, and a frame stays in force until the next one arrives. The limit holds for every motion with
|α| <= max_acceleration over Δ = age + one period + the longest transit, and at least one period more, by which the next
frame is late; not beyond. The age begins with the command that the feedback answers, so it contains the ways of both.

    share(x, r)   the largest s <= 1 with |τ_ff + s x| + s r <= limit

Principle: 1. If share(K (θ₀ − θ) + B (ω₀ − ω), K (|ω| Δ + ½ a Δ²) + B a Δ) = 1, the whole law fits and is sent
unchanged. 2. Otherwise the commanded torque is sent as feed-forward, with gains about the state half-way through the
frame that use the rest of the limit. Scaling the gains to the limit would be equally safe, but would remove most of
the impedance. 3. Damping is at most 2 limit / (a Δ): more would make a light joint oscillate. 4. Feed-forward lags by
the age and half a period, so a spring sent as feed-forward adds energy. Beyond its share it is limited to the power
that half the damping dissipates; without damping this is plain scaling. 5. The transitions are continuous.

Each spread includes two codes of position and velocity, of the feedback and of the command.
"""

from libc.math cimport copysign, fabs, fmax, fmin, isfinite

from cext.abi cimport NOT_FINITE, OK, OUT_OF_LIMITS

cdef struct Law:                # as commanded, then as sent
    double position             # θ₀, rad
    double velocity             # ω₀, rad/s
    double stiffness            # K
    double damping              # B
    double torque               # τ_ff, N·m

cdef struct Known:              # data from which a frame is computed
    double position             # newest feedback, rad
    double velocity             # rad/s
    double age                  # s
    double period               # s, until the next frame
    double late                 # s, by which that may be late
    double acceleration         # a, rad/s²
    bint fresh                  # whether the age permits gains
    double gains                # permitted fraction of stiffness and damping
    double offset               # offset of the codes of position, rad
    double position_end         # largest values that a frame can carry
    double velocity_end
    double position_step        # one code
    double velocity_step
    double stiffness_step
    double damping_step
    double share                # share of stiffness, damping and torque that is sent, above 0: the fade-in


cdef inline int accept(Law *law, const double *limits, double share, bint *limited) noexcept nogil:
    """Check the five commands, and limit their torque. Returns OK or the reason for rejection.

    limits : half ranges of position, velocity, stiffness, damping and torque, then the torque limit of the drive
    share : permitted fraction of stiffness, damping and torque, from 0 to 1
    limited : receives whether the torque was limited
    """
    if not (isfinite(law.position) and isfinite(law.velocity) and isfinite(law.stiffness) and isfinite(law.damping)
            and isfinite(law.torque)):
        return NOT_FINITE
    if (not -limits[0] <= law.position <= limits[0] or not -limits[1] <= law.velocity <= limits[1]
            or not 0.0 <= law.stiffness <= limits[2] or not 0.0 <= law.damping <= limits[3]
            or not -limits[4] <= law.torque <= limits[4]):
        return OUT_OF_LIMITS
    if not (0.0 <= share <= 1.0 and limits[5] >= 0.0):
        return OUT_OF_LIMITS    # with NaN it would be full torque
    limited[0] = fabs(law.torque) > limits[5]
    if limited[0]:
        law.torque = copysign(limits[5], law.torque)
    return OK


cdef inline double oldest_age(double period, double max_transit) noexcept nogil:
    """Return the age of feedback, in s, up to which a frame has gains: of two periods, or of one and a transit."""
    return fmax(2.0 * period, period + max_transit) + 1e-9


cdef inline void know_times(
        Known *known, double age, double period, double max_transit, const double *transit) noexcept nogil:
    """Set the times.

    age, period, max_transit : s
    transit : s, the longest transit that was measured, and the times by which feedback may be older than `age`
    """
    known.fresh = age + transit[2] <= oldest_age(period, max_transit)
    known.age, known.period, known.late = age + transit[1] + transit[2], period, fmax(period, transit[0])


cdef inline double quotient(double room, double need) noexcept nogil:
    """Return the fraction of `need` that fits, 0 to 1."""
    return 1.0 if need <= room else room / need if room > 0.0 else 0.0


cdef inline bint keep_inside(Law *law, const Known *known, double limit) noexcept nogil:
    """Limit a law so that |τ| <= limit wherever the joint may be until a late next frame. Returns whether it changed.

    Requires |τ_ff| <= limit.
    """
    cdef double a = known.acceleration
    cdef double K = law.stiffness
    cdef double B = law.damping
    cdef double half_way = known.age + 0.5 * known.period
    cdef double end = known.age + known.period + known.late
    cdef double speed = fabs(known.velocity) + 2.0 * known.velocity_step
    cdef double position_error = law.position - known.position
    cdef double velocity_error = law.velocity - known.velocity
    cdef double ahead = known.position + known.velocity * half_way
    cdef double of_spring = speed * end + 0.5 * a * end * end + 2.0 * known.position_step
    cdef double of_damper = a * end + 2.0 * known.velocity_step
    cdef double gains = known.gains
    cdef double spread = K * of_spring + B * of_damper
    cdef double error = K * position_error + B * velocity_error
    cdef double share, most, torque, lost, gained
    if not (known.fresh and isfinite(ahead)):
        law.stiffness = law.damping = 0.0
        return True
    if not (fmax(fabs(ahead + known.offset), fabs(known.position + known.offset)) < known.position_end - 2.0
        * known.position_step
            and speed < known.velocity_end):
        gains = 0.0             # the last code may represent any value beyond the range
    # error of the law due to the truncation of the gains, which the share does not reduce
    lost = known.stiffness_step * fmax(position_error, 0.0) + known.damping_step * fmax(velocity_error, 0.0)
    gained = known.stiffness_step * fmax(-position_error, 0.0) + known.damping_step * fmax(-velocity_error, 0.0)
    if (gains >= 1.0 and known.share * (error + spread) + gained <= known.share * (limit - law.torque)
            and known.share * (spread - error) + lost <= known.share * (limit + law.torque)):
        return False
    B = fmin(B, 2.0 * limit / (a * end))
    error = K * position_error + B * velocity_error
    spread = K * of_spring + B * of_damper
    share = gains * fmin(quotient(limit - law.torque, error + spread), quotient(limit + law.torque, spread - error))
    most = fmin(1.0, share + 0.5 * B / (K * half_way)) if K > 0.0 else 1.0
    torque = law.torque + most * K * (position_error - known.velocity * half_way) + B * velocity_error
    if fabs(torque) > limit:
        torque = copysign(limit, torque)
    spread -= K * speed * half_way
    share = fmin(fmin(most, gains), quotient(limit - fabs(torque), spread))
    law.position, law.velocity, law.stiffness = ahead, known.velocity, share * K
    law.damping, law.torque = share * B, torque
    return True
