"""What a person feels of a drive that closes the loop itself: its whole law, τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, kept inside a limit."""

from libc.math cimport fabs, fmax

cdef struct Law:                # with the newest feedback
    double stiffness            # K
    double damping              # B
    double torque               # τ_ff, N·m
    double position_error       # θ₀ − θ, rad
    double velocity_error       # ω₀ − ω, rad/s
    double velocity             # ω
    double age                  # s, of the feedback
    double period               # s, until the next frame
    double position_step        # what one code means
    double velocity_step
    double stiffness_step
    double damping_step


cdef inline double share_inside(const Law *law, double limit) noexcept nogil:
    """The largest share of K and B with which |τ| <= limit until the next frame; 0 on feedback older than two periods.

    Principle: 1. the joint moves by at most |ω| times the time since the feedback and until the next frame, and codes are rounded, which spreads
    spring and damper; 2. rounding makes K and B smaller, so where the two pull against each other either holds back less than it should;
    3. with these, |s (K (θ₀ − θ) + B (ω₀ − ω)) + τ_ff| + s spread <= limit is solved for s. |τ_ff| <= limit is given.
    """
    cdef double spring = law.stiffness * law.position_error
    cdef double damper = law.damping * law.velocity_error
    cdef double moves = fabs(law.velocity) * (law.age + law.period)
    cdef double spread = law.stiffness * (moves + 2.0 * law.position_step) + law.damping * 2.0 * law.velocity_step
    cdef double error = spring + damper
    cdef double share = 1.0
    if not law.age <= 2.0 * law.period + 1e-9:
        return 0.0
    if spring * damper < 0.0:
        limit -= fmax(law.stiffness_step * (fabs(law.position_error) + moves), law.damping_step * fabs(law.velocity_error))
    if limit < fabs(law.torque):
        limit = fabs(law.torque)
    if error + spread > limit - law.torque:
        share = (limit - law.torque) / (error + spread)
    if share * (spread - error) > limit + law.torque:
        share = (limit + law.torque) / (spread - error)
    return share
