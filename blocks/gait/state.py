"""Whether the wearer walks, stands, or does neither as expected, and torques that fade with it."""

from __future__ import annotations

from cext.kernels import gait_state as kernels
from graph import Block, Input, Interval, Memory, Output, Param

MODES = ("zero", "damping", "hold")


class GaitState(Block):
    """State of the gait from both legs: 2 walking, 1 standing, 0 unknown, and its confidence.

    Standing: both velocities are below a limit for `still_time`, or below `still_velocity` for 1.5 s, as in a stance in
    which the weight shifts from leg to leg. The limit is `still_velocity`, or 15 % of the largest velocity in recent
    walking if that is less, and at least a quarter of `still_velocity`. At 0.2 to 1.2 m/s both thighs or knees are that
    slow for less than 0.09 s at a time.

    Walking: both phases are known, and they are half a stride apart within `tolerance`, in a mean of 0.3 s, and each
    leg has been faster than the limit within 1.5 s; at 0.15 to 1.9 m/s a thigh or knee pauses for 1.2 s at most. Any
    other motion is unknown, such as a squat, in which both knees move together, or one leg that swings while the other
    stands, or a stumble, in which the difference of both phases leaves its usual value by more than 9 to 18 % of a
    stride: five times its usual RMS deviation, learned with a weight of 30 % for each stride. A stumble ends when each
    leg has begun a new stride, or two with `motion` "knee". The confidence is 1 in standing and
    1 − deviation / tolerance in walking.

    Walking is forward: a leg swings forward faster than it turns back over the ground. Each of these numbers, from
    means over 0.9 strides, is positive in walking forward and negative in walking backward:

        with shanks  Σ mean(ω³) / Σ mean(ω²)^1.5 of their rates ω; walking begins above 0.45 and ends below 0.3
        without      correlation of the sum of both velocities with the square of their difference; 0.15 and 0
        with knees   −Σ mean(q ω) / (2 √(mean(q) mean(q ω²))); −0.05 and −0.3

    where ω is the velocity of the other knee, which extends in stance while this one is flexed in swing, and q the
    square of the flexion of this one beyond its mean. A stand discards them, since the next steps may go the other way.
    If it lasts for 1 s, walking begins half a stride after it at the earliest; else, as with sticks, it continues
    unless a number is negative from 0.15 strides after it on. `direction` is the number that is used, scaled to 0 where
    walking ends and 1 where it may begin. For a robot with one leg, connect the rate of its shank.

    Limits: standing is not detected if the thighs sway faster than the limit; without shanks, stepping in place can
    count as walking; knees that hardly extend in stance, or an uneven gait, can count as the other direction. Direct
    feedthrough; NaN and infinity give a NaN confidence, except NaN as the rate of a shank, which is skipped.
    """

    still_velocity = Param(0.25, "rad/s", "largest velocity of a standing leg", above=0.0)
    still_time = Param(0.15, "s", "time of low velocity after which the state is standing", above=0.0)
    tolerance = Param(0.15, "1", "largest deviation of the phases from half a stride", above=0.0, max=0.5)
    motion = Param("thigh", "1", "what the velocities belong to; a hip counts as a thigh", choices=("thigh", "knee"))

    left_phase = Input("1", "gait phase of the left leg")
    right_phase = Input("1", "gait phase of the right leg")
    left_walking = Input("1", "true while the left phase is known", dtype=bool)
    right_walking = Input("1", "true while the right phase is known", dtype=bool)
    left_velocity = Input("rad/s", "velocity of the left thigh, hip or knee, positive in flexion")
    right_velocity = Input("rad/s", "velocity of the right thigh, hip or knee, positive in flexion")
    left_shank_velocity = Input("rad/s", "rate of the left shank, positive when it swings forward", default=0.0)
    right_shank_velocity = Input("rad/s", "rate of the right shank, positive when it swings forward", default=0.0)
    state = Output("1", "2 walking, 1 standing, 0 unknown", dtype=int, range=(0.0, 2.0))
    walking = Output("1", "true in walking", dtype=bool, range=(0.0, 1.0))
    standing = Output("1", "true in standing", dtype=bool, range=(0.0, 1.0))
    confidence = Output("1", "confidence of the state", range=(0.0, 1.0))
    direction = Output("1", "evidence of walking forward, which begins above 1 and ends below 0; 0 without")
    knees = Memory(0.0, "1 if the velocities are those of knees")
    evidence = Memory((0.0,) * 22, "moments of the velocities, stride of the left leg, and the decision")
    track = Memory(
        (0.0, 0.5, 0.0, 0.0, 0.0, 0.0), "times without motion, deviation of the phases, largest velocity in walking"
    )
    apart = Memory((0.5, 0.0025) + (0.0,) * 7, "usual difference of the phases and its spread, and a stumble")

    kernel = kernels.gait_state

    def configure(self) -> None:
        self.knees = float(self.motion == "knee")


class StrideEnvelope(Block):
    """Comparison with the wearer's mean stride: deviation = (u − mean(phase)) / max(deviations · SD, smallest).

    Mean and standard deviation (SD) of u are learned in 50 bins of the phase: over the first `strides` with equal
    weights, then with a weight of 5 % for each new stride. `inside` becomes false when |deviation| has exceeded 1 for
    `outside_time`, and true again after `recovery` inside. Strides outside are not learned. The block's own phase
    advances as in the last stride and follows the input within 0.3 of a stride, so that a phase estimated from u does
    not hide that u deviates. Limits: where strides vary much, a push of 15° for 0.1 s stays inside; a change of speed
    by half within a stride does not. Direct feedthrough; NaN and infinity give NaN.
    (deviation from a mean trajectory: Lawson et al. 2010)
    """

    deviations = Param(4.0, "1", "half width of the envelope, in standard deviations", above=0.0)
    smallest = Param(0.15, "any", "smallest half width, in the unit of u", above=0.0)
    strides = Param(5, "1", "number of strides that are learned before the comparison starts", min=2, max=100)
    outside_time = Param(0.04, "s", "time outside the envelope after which `inside` becomes false", min=0.0)
    recovery = Param(1.0, "s", "time inside the envelope after which `inside` becomes true again", min=0.0)

    phase = Input("1", "gait phase, 0 at heel strike")
    u = Input("any", "angle or other signal of the leg")
    walking = Input("1", "true while the phase is known", dtype=bool, default=True)
    inside = Output("1", "false from leaving the envelope until `recovery`", dtype=bool, range=(0.0, 1.0))
    deviation = Output("1", "deviation from the mean over the half width of the envelope; 0 while learning")
    means = Memory((0.0,) * 50, "mean of each bin")
    variances = Memory((0.0,) * 50, "variance of each bin")
    counts = Memory((0.0,) * 50, "samples in each bin")
    track = Memory((0.0, 0.0, 0.0, -1.0) + (0.0,) * 4, "times outside and inside, last bin, and the predicted phase")

    kernel = kernels.stride_envelope


class TorqueGate(Block):
    """Fade of a torque: y = s u + (1 − s) rest, s from 0 to 1 in `fade_in` and back in `fade_out` seconds.

    s rises while `enable` is true, to (uncertain − uncertainty) / (uncertain − certain) within 0 and 1: a phase of
    which the `uncertainty` is large gives less torque. rest is 0 in the mode "zero", −damping · ω within ±limit in the
    mode "damping", and the last torque while enabled in the mode "hold". With `standing` of a GaitState, a fade of 0.1
    s ends the torque 0.25 s after the last motion. Direct feedthrough; NaN passes and infinity becomes NaN.
    """

    rules = ("certain < uncertain",)

    mode = Param("zero", "1", "torque while disabled", choices=MODES)
    fade_in = Param(0.5, "s", "time from 0 to the full torque", above=0.0)
    fade_out = Param(0.1, "s", "time from the full torque to 0", above=0.0)
    damping = Param(1.0, "N·m·s/rad", "damping in the mode damping", min=0.0)
    limit = Param(5.0, "N·m", "largest damping torque", min=0.0)
    certain = Param(0.05, "1", "largest uncertainty of the phase with the full torque", min=0.0)
    uncertain = Param(0.1, "1", "uncertainty of the phase from which no torque acts", above=0.0)

    u = Input("N·m", "torque")
    enable = Input("1", "true while the torque may act", dtype=bool)
    velocity = Input("rad/s", "joint velocity, for the mode damping", default=0.0)
    uncertainty = Input("1", "standard deviation of the phase, as a fraction of a stride", default=0.0)
    y = Output("N·m", "faded torque")
    mode_number = Memory(0.0, "index of the mode")
    track = Memory((0.0, 0.0), "share s, held torque")

    kernel = kernels.torque_gate.renamed(mode="mode_number")

    def configure(self) -> None:
        self.mode_number = float(MODES.index(self.mode))

    def output_range(self, u: Interval, enable: Interval, velocity: Interval, uncertainty: Interval) -> Interval:
        faded = u | Interval.point(0.0)
        if self.mode != "damping":
            return faded
        limit = self.span("limit").high
        return faded | Interval(-limit, limit)
