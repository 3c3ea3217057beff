"""Assistance torques over the gait phase, from the biological torque, and from the motion of both legs."""

from __future__ import annotations

import math

from cext.kernels import gait_torque as kernels
from graph import Block, Input, Interval, Memory, Output, Param

DELAY_LIMIT = 0.5  # s
ZERO = Interval.point(0.0)


class _Delayed:
    """Memory of a delay and of two low-passes behind it."""

    held = Memory(0.0, "last values")
    place = Memory((0.0, 0.0), "index of the next, number stored")
    low_pass = Memory((0.0, 0.0), "outputs of the low-passes")

    def prepare(self, dt: float) -> None:
        self.held = [0.0] * (math.ceil(DELAY_LIMIT / dt) + 2)


class PeakProfile(Block):
    """Torque with one peak per stride, two cubics: 0 to `peak` in `rise`, back to 0 in `fall`.   (Zhang et al. 2017)

    τ = peak · (3 x² − 2 x³), x from 0 at peak_time − rise to 1 at peak_time, and back to 0 at peak_time + fall. All
    four are live and hold for every leg of the input: `PeakProfile()(stack(left.phase, right.phase))` assists both.
    The torque is 0 while `enable` is false. Where rise and fall overlap, the fall is used. Direct feedthrough; NaN
    passes and infinity becomes NaN.
    """

    peak = Param(10.0, "N·m", "torque at the peak", min=-200.0, max=200.0, live=True)
    peak_time = Param(0.5, "1", "phase of the peak", min=0.0, max=1.0, live=True)
    rise = Param(0.25, "1", "phase from 0 to the peak", min=0.01, max=0.99, live=True)
    fall = Param(0.12, "1", "phase from the peak to 0", min=0.01, max=0.99, live=True)

    phase = Input("1", "gait phase, 0 at heel strike", shape=...)
    enable = Input("1", "false sets the torque to 0", dtype=bool, shape=..., default=True)
    torque = Output("N·m", "torque τ", shape=...)

    kernel = kernels.peak_profile

    def output_range(self, phase: Interval, enable: Interval) -> Interval:
        return self.span("peak") | ZERO


class SplineProfile(Block):
    """Torque through eight live points at the phases 0, 1/8, ..., 7/8: a periodic monotone cubic.

    It never leaves the range of two neighbouring points (Fritsch and Butland 1984); the points are what an optimiser
    tunes. The torque is 0 while `enable` is false. For points at other phases see TorqueProfile. Direct feedthrough;
    NaN passes and infinity becomes NaN.
    """

    locals().update(
        (f"point_{k}", Param(0.0, "N·m", f"torque at the phase {k}/8", min=-200.0, max=200.0, live=True))
        for k in range(8)
    )

    phase = Input("1", "gait phase, 0 at heel strike", shape=...)
    enable = Input("1", "false sets the torque to 0", dtype=bool, shape=..., default=True)
    torque = Output("N·m", "torque", shape=...)

    kernel = kernels.spline_profile

    def output_range(self, phase: Interval, enable: Interval) -> Interval:
        low, high = zip(*((span.low, span.high) for span in (self.span(f"point_{point}") for point in range(8))))
        return Interval(min(low), max(high)) | ZERO


class BiologicalTorque(_Delayed, Block):
    """Share of an estimated biological torque: τ = scale · low-pass(m(t − delay)).   (Molinaro et al. 2024)

    Two first-order low-passes in series, −3 dB at `cutoff`, without overshoot. Published assistance of hip and knee
    uses 0.15 to 0.2 of the moment, delayed by up to 0.2 s, below 6 Hz. Direct feedthrough; NaN passes and is not
    stored, infinity becomes NaN.
    """

    scale = Param(0.2, "1", "share of the biological torque", min=0.0, max=1.0, live=True)
    delay = Param(0.1, "s", "delay", min=0.0, max=DELAY_LIMIT, live=True)
    cutoff = Param(6.0, "Hz", "cut-off frequency of the low-pass", above=0.0)

    moment = Input("N·m", "estimated biological torque m")
    torque = Output("N·m", "torque τ")

    kernel = kernels.biological_torque

    def output_range(self, moment: Interval) -> Interval:
        return self.span("scale") * (moment | ZERO)


class DelayedOutputFeedback(_Delayed, Block):
    """Hip assistance without a gait phase: τ_right = −τ_left = gain · y(t − delay), y = sin θ_left − sin θ_right.

    y passes two first-order low-passes, −3 dB at `cutoff`. With the delay of about a quarter of a stride the torque is
    in phase with the velocity of the thighs. It fades with the amplitude of the motion, and stays while the wearer
    stands with legs apart. Direct feedthrough; NaN passes and is not stored, infinity becomes NaN.
    (Lim et al. 2019, IEEE Transactions on Robotics 35)
    """

    gain = Param(8.0, "N·m", "torque per unit of y", min=0.0, max=50.0, live=True)
    delay = Param(0.25, "s", "delay", min=0.0, max=DELAY_LIMIT, live=True)
    cutoff = Param(6.0, "Hz", "cut-off frequency of the low-pass", above=0.0)

    left_angle = Input("rad", "flexion of the left thigh")
    right_angle = Input("rad", "flexion of the right thigh")
    left_torque = Output("N·m", "flexion torque of the left hip")
    right_torque = Output("N·m", "flexion torque of the right hip")

    kernel = kernels.delayed_feedback

    def output_range(self, left_angle: Interval, right_angle: Interval) -> Interval:
        most = 2.0 * self.span("gain").high
        return Interval(-most, most)


class StanceSwingImpedance(Block):
    """Spring and damper in stance, a damper in swing: τ = K (θ₀ − θ) − B_stance ω, then τ = −B_swing ω.

    Stance lasts from phase 0 to `toe_off`; the two laws fade into each other in `transition`. The torque is 0 while
    `enable` is false. A damper brakes its wearer wherever the joint moves. Direct feedthrough; NaN passes and infinity
    becomes NaN.   (finite-state impedance: Sup et al. 2008)
    """

    stiffness = Param(30.0, "N·m/rad", "stiffness K in stance", min=0.0, max=300.0, live=True)
    equilibrium = Param(0.1, "rad", "equilibrium θ₀ in stance", min=-1.0, max=2.0, live=True)
    stance_damping = Param(0.0, "N·m·s/rad", "damping in stance", min=0.0, max=10.0, live=True)
    swing_damping = Param(0.3, "N·m·s/rad", "damping in swing", min=0.0, max=10.0, live=True)
    toe_off = Param(0.6, "1", "phase at the end of stance", above=0.0, below=1.0)
    transition = Param(0.05, "s", "time from one law to the other", above=0.0)

    phase = Input("1", "gait phase, 0 at heel strike")
    position = Input("rad", "joint angle θ")
    velocity = Input("rad/s", "joint velocity ω")
    enable = Input("1", "false sets the torque to 0", dtype=bool, default=True)
    torque = Output("N·m", "torque τ")
    share = Memory(0.0, "share of the law of stance")

    kernel = kernels.stance_swing

    def output_range(self, phase: Interval, position: Interval, velocity: Interval, enable: Interval) -> Interval:
        spring = self.span("stiffness") * (self.span("equilibrium") - position)
        stance = spring - self.span("stance_damping") * velocity
        return stance | (ZERO - self.span("swing_damping") * velocity) | ZERO
