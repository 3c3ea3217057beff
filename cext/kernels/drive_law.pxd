"""What a person feels of a drive that closes the loop itself: its whole law, τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, kept inside a limit."""

from libc.math cimport fabs

cdef struct Law:                # as it would be with the newest feedback, N·m
    double spring               # K (θ₀ − θ)
    double damper               # B (ω₀ − ω)
    double torque               # τ_ff
    double spread               # by which the first two may change before the next frame reaches the drive
    double spring_loss          # what the wire's rounding of K may take from the first,
    double damper_loss          # and that of B from the second


cdef inline double share_inside(const Law *law, double limit) noexcept nogil:
    """The largest share s of [0, 1] of K and B with which |τ| <= limit for all that may come. τ_ff is inside the limit.

    Rounding makes K and B smaller. Where spring and damper pull against each other, the weaker one then holds back less than it should.
    """
    cdef double error = law.spring + law.damper
    cdef double share = 1.0
    if law.spring * law.damper < 0.0:
        limit -= law.spring_loss if fabs(law.spring) < fabs(law.damper) else law.damper_loss
    if limit < fabs(law.torque):
        limit = fabs(law.torque)
    if error + law.spread > limit - law.torque:
        share = (limit - law.torque) / (error + law.spread)
    if share * (law.spread - error) > limit + law.torque:
        share = (limit + law.torque) / (law.spread - error)
    return share
