"""Gait phase from filters that run in step with the leg: adaptive oscillators, and a Kalman filter."""

from __future__ import annotations

import math

from cext.kernels import gait_phase as kernels
from graph import Block, Input, Memory, Output, Param


class AdaptiveOscillator(Block):
    """Gait phase from coupled oscillators that learn frequency and shape of an angle.

        e      = θ − α₀ − Σ αᵢ sin φᵢ
        dφᵢ/dt = i ω + (ν e / Σα) cos φᵢ
        dω/dt  = (ν_ω e / Σα) cos φ₁
        dαᵢ/dt = η e sin φᵢ,  dα₀/dt = η e

    (Righetti et al. 2006; Ronsse et al. 2013) The phase is φ₁ less its value at heel strike, the mean of the first
    ten strikes after 4 s; from then on, the share `correction` of the phase error is corrected at each strike (Yan et
    al. 2017). While the velocity of the angle has been below 15 % of its usual value for 0.2 s, ω and α hold; the next
    strike is phase 0. Where two strides of equal length contradict ω by more than a quarter, ω is set to theirs. A
    strike more than a fifth of a stride from phase 0 ends `walking` until a strike agrees.

    Limits: locks within about five strides, lags while the speed changes, is wrong by 5 to 25 % of a stride while
    strides take 2 s or longer, and does not detect standing in white noise of 0.02 rad. Direct feedthrough; NaN and
    infinity give NaN and are not stored.
    """

    start = Param(0.9, "Hz", "frequency at the start", above=0.2, max=2.5, fixed=True)
    harmonics = Param(3, "1", "number of oscillators", min=1, max=8, fixed=True)
    phase_gain = Param(12.0, "1/s", "ν, gain of the phases", min=0.0)
    frequency_gain = Param(20.0, "1/s²", "ν_ω, gain of the frequency", min=0.0)
    amplitude_gain = Param(2.0, "1/s", "η, gain of the amplitudes", min=0.0)
    correction = Param(0.3, "1", "share of the phase error at a strike that is corrected; 0 for none", min=0.0, max=1.0)

    angle = Input("rad", "flexion of the thigh from vertical, or of the hip")
    strike = Input("1", "true for one tick at heel strike", dtype=bool)
    phase = Output("1", "gait phase: 0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "true while the oscillators follow the angle", dtype=bool, range=(0.0, 1.0))
    frequency = Output("Hz", "stride frequency")
    state = Memory((0.0,) * 11, "zero of the phase, ω, α₀, time, mean squared error, and motion of the leg")
    amplitudes = Memory(0.0, "amplitudes αᵢ, then phases φᵢ")
    zero = Memory((0.0, 0.0, 0.0, math.inf), "offset: cosines, sines, strikes; time since the last strike")

    kernel = kernels.adaptive_oscillator

    def configure(self) -> None:
        self.state = (0.0, 2.0 * math.pi * self.start) + (0.0,) * 9
        self.amplitudes = (0.3,) + (0.0,) * (2 * self.harmonics - 1)


class PhaseKalmanFilter(Block):
    """Gait phase from an extended Kalman filter on the wearer's own waveform of an angle.

    State: phase φ, frequency f, amplitude g, offset b. Measurements: θ = mean + g w(φ) + b and its velocity
    g f dw/dφ, where w is a Fourier series of 8 harmonics, the mean of the last ten strides between heel strikes. The
    noise of each measurement is relative to the standard deviation of angle and velocity over a stride, so that
    amplitude, sign and segment make no difference. Errors are limited to three standard deviations.

    A strike is a measurement of phase 0. If the phase is more than a fifth of a stride from 0, the filter starts again
    at 0, with the offset of the last stride if that exceeds half a standard deviation, as after a sensor has slipped.

    The frequency returns to that of the last stride with a time constant of 1 s. While the leg moves, the frequency is
    at least half of that and the phase does not decrease: at a turning point neither angle nor velocity determines
    them.

    In a stand the angle does not determine the phase: after 0.8 strides it is that at which the leg came to rest, from
    which it continues. Until the next strike it changes to another phase if angle and velocity are nearer to that, by
    4 in the sum of their squared errors in standard deviations.

    `walking` is true from a strike on, while the frequency is above 0.3 Hz, or half of that of the last stride if that
    is less, and the angle follows the waveform. `uncertainty` is √(mean square of the phase at the last strikes +
    strike_offset²), where each strike has a weight of 20 %, and 0.29, that of an unknown phase, while `walking` is
    false. Limits: two strides are learned first; strides shorter than 0.4 s or longer than 2.5 s are not learned; a
    strike detected late delays the phase by as much, which the strikes do not show: set `strike_offset` for a detector
    that predicts them.
    Direct feedthrough; NaN and infinity give NaN and are not stored.
    (phase-based Kalman filter: Thatte et al. 2019; Medrano et al. 2023)
    """

    phase_noise = Param(0.02, "1", "standard deviation of the phase after a stride, in strides", min=0.0)
    frequency_noise = Param(0.2, "Hz", "standard deviation of the change of frequency in one second", min=0.0)
    angle_noise = Param(0.4, "1", "noise of the angle, relative to its standard deviation in a stride", above=0.0)
    velocity_noise = Param(0.8, "1", "noise of the velocity, relative to its standard deviation in a stride", above=0.0)
    strike_noise = Param(0.03, "1", "noise of a heel strike, as a fraction of a stride", above=0.0)
    strike_offset = Param(
        0.0, "1", "standard deviation of the mean offset of the strikes between wearers, in strides", min=0.0, max=0.2
    )

    angle = Input("rad", "periodic angle of the leg: thigh, shank, hip or knee")
    velocity = Input("rad/s", "velocity of the angle")
    strike = Input("1", "true for one tick at heel strike", dtype=bool)
    phase = Output("1", "gait phase: 0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "true while the phase is known and advances", dtype=bool, range=(0.0, 1.0))
    frequency = Output("Hz", "stride frequency, 0 while unknown")
    deviation = Output("1", "angle minus its prediction, in standard deviations of the angle over a stride")
    uncertainty = Output("1", "standard deviation of the phase, as a fraction of a stride", range=(0.0, 0.3))
    state = Memory((0.0, 0.0, 1.0, 0.0), "phase, frequency, amplitude, offset")
    covariance = Memory((0.0,) * 16, "covariance of the state")
    waveform = Memory((0.0,) * 17, "mean, cosine and sine amplitudes")
    stride = Memory(0.0, "angles since the last strike")
    learning = Memory(
        (math.inf,) + (0.0,) * 13 + (0.0009, 0.0, 0.0), "learning of the waveform, and checks of the filter"
    )

    kernel = kernels.phase_kalman

    def prepare(self, dt: float) -> None:
        self.stride = [0.0] * (math.ceil(2.5 / dt) + 1)
