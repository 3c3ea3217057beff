"""Gait phase of a leg: from the time since heel strike, a network, and the portrait of the thigh."""

from __future__ import annotations

import math

from cext.kernels import gait_phase as kernels
from graph import Block, Input, Memory, Output, Param


class StridePhase(Block):
    """Gait phase from heel strikes: phase = min(elapsed / mean stride time, 1).

    The mean of the first `count` strides has equal weights; from then on each new stride has the weight 1 / `count`.
    `walking` is true from the third strike until one and a half strides pass without one; a stride outside `shortest`
    to `longest` starts the mean again. `uncertainty` is the RMS difference of the last strides from the mean. Limits: a
    change of speed within a stride shows at the next strike only. Direct feedthrough; NaN passes.
    (time-based estimation, as in Zhang et al. 2017)
    """

    rules = ("shortest < longest",)

    count = Param(3, "1", "strides of the mean: a new one has the weight 1 / count", min=1, max=20)
    shortest = Param(0.5, "s", "shortest accepted stride", above=0.0)
    longest = Param(2.5, "s", "longest accepted stride", above=0.0)

    strike = Input("1", "true for one tick at heel strike", dtype=bool)
    phase = Output("1", "gait phase: 0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "true while the phase is known", dtype=bool, range=(0.0, 1.0))
    stride_time = Output("s", "mean stride time, 0 while unknown")
    uncertainty = Output("1", "standard deviation of the phase at the next strike", range=(0.0, 0.3))
    state = Memory((math.inf, 0.0, 0.0, 0.0009), "time since the strike, mean stride time, strides, their variance")

    kernel = kernels.stride_phase


class CirclePhase(Block):
    """Gait phase from the estimates of its cosine and sine: phase = atan2(sine, cosine) / 2π.

    Estimates with the least squared error are the means over all phases that the measurements allow. Their length
    R = √(cosine² + sine²) shows how far these are apart:

        uncertainty = √(mean(−2 ln R)) / 2π

    which is the circular standard deviation, with the mean over 0.3 s. `walking` is true while R exceeds 0.5, and the
    uncertainty is 0.29, that of an unknown phase, while it is false: a network that is trained with zeros in standing
    ends it there. Direct feedthrough; NaN and infinity give NaN and are not stored.
    (circular statistics: Mardia and Jupp 2000)
    """

    cosine = Input("1", "estimate of the cosine of the phase")
    sine = Input("1", "estimate of the sine of the phase")
    phase = Output("1", "gait phase: 0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "true while the phase is known", dtype=bool, range=(0.0, 1.0))
    uncertainty = Output("1", "standard deviation of the phase, as a fraction of a stride", range=(0.0, 0.3))

    variance = Memory(-1.0, "mean variance of the phase, negative while unknown")

    kernel = kernels.circle_phase


class PhasePortrait(Block):
    """Gait phase from angle and velocity of a thigh: phase = (atan2(−ω / ω_max, 2 (θ − θ_mid) / range) − α₀) / 2π.

    The extremes of the last stride scale the portrait: θ_mid and range are the middle and the width of the range of the
    angle, ω_max is the largest speed. α₀ is the mean of atan2(...) at the first ten heel strikes; the phase is 0 until
    three are learned. It responds at once to the thigh, never runs backwards, and waits at 1 for the strike. Limits: it
    is not linear in time (4 to 7 % RMS of a stride), and stands still with the thigh. Direct feedthrough; NaN and
    infinity give NaN.
    (Villarreal et al. 2017; Quintero et al. 2018)
    """

    angle = Input("rad", "flexion of the thigh from vertical, or of the hip")
    velocity = Input("rad/s", "velocity of the thigh or hip")
    strike = Input("1", "true for one tick at heel strike", dtype=bool)
    phase = Output("1", "gait phase: 0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "true while strikes come within 3 s of each other", dtype=bool, range=(0.0, 1.0))
    extremes = Memory((0.0, 0.0, 0.0, math.inf, -math.inf, 0.0), "smallest, largest angle, speed: in use, and new")
    zero = Memory((0.0, 0.0, 0.0, math.inf), "offset: cosines, sines, strikes; time since the last strike")
    latest = Memory(0.0, "phase one tick before")

    kernel = kernels.phase_portrait
