# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class AdaptiveOscillator(Block):
    start: Param[float]
    harmonics: Param[int]
    phase_gain: Param[float]
    frequency_gain: Param[float]
    amplitude_gain: Param[float]
    correction: Param[float]
    angle: Input
    strike: Input
    phase: Output
    walking: Output
    frequency: Output
    state: Memory
    amplitudes: Memory
    zero: Memory
    def __init__(
        self,
        start: float = 0.9,
        harmonics: int = 3,
        phase_gain: float | Live = 12.0,
        frequency_gain: float | Live = 20.0,
        amplitude_gain: float | Live = 2.0,
        correction: float | Live = 0.3,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        phase: Signal
        walking: Signal
        frequency: Signal
    def __call__(self, angle: Operand = ..., strike: Operand = ...) -> Outputs: ...
class PhaseKalmanFilter(Block):
    phase_noise: Param[float]
    frequency_noise: Param[float]
    angle_noise: Param[float]
    velocity_noise: Param[float]
    strike_noise: Param[float]
    angle: Input
    velocity: Input
    strike: Input
    phase: Output
    walking: Output
    frequency: Output
    deviation: Output
    state: Memory
    covariance: Memory
    waveform: Memory
    stride: Memory
    learning: Memory
    def __init__(
        self,
        phase_noise: float | Live = 0.02,
        frequency_noise: float | Live = 0.2,
        angle_noise: float | Live = 0.4,
        velocity_noise: float | Live = 0.8,
        strike_noise: float | Live = 0.03,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        phase: Signal
        walking: Signal
        frequency: Signal
        deviation: Signal
    def __call__(self, angle: Operand = ..., velocity: Operand = ..., strike: Operand = ...) -> Outputs: ...
