# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

DELAY_LIMIT: float
ZERO: Any
class _Delayed:
    held: Any
    place: Any
    low_pass: Any
    def prepare(self, dt: float) -> None: ...
class PeakProfile(Block):
    peak: Param[float]
    peak_time: Param[float]
    rise: Param[float]
    fall: Param[float]
    phase: Input
    enable: Input
    torque: Output
    def __init__(
        self,
        peak: float | Live = 10.0,
        peak_time: float | Live = 0.5,
        rise: float | Live = 0.25,
        fall: float | Live = 0.12,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, phase: Operand = ..., enable: Operand = ...) -> Signal: ...
class SplineProfile(Block):
    point_0: Param[float]
    point_1: Param[float]
    point_2: Param[float]
    point_3: Param[float]
    point_4: Param[float]
    point_5: Param[float]
    point_6: Param[float]
    point_7: Param[float]
    phase: Input
    enable: Input
    torque: Output
    def __init__(
        self,
        point_0: float | Live = 0.0,
        point_1: float | Live = 0.0,
        point_2: float | Live = 0.0,
        point_3: float | Live = 0.0,
        point_4: float | Live = 0.0,
        point_5: float | Live = 0.0,
        point_6: float | Live = 0.0,
        point_7: float | Live = 0.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, phase: Operand = ..., enable: Operand = ...) -> Signal: ...
class BiologicalTorque(_Delayed, Block):
    scale: Param[float]
    delay: Param[float]
    cutoff: Param[float]
    moment: Input
    torque: Output
    def __init__(
        self,
        scale: float | Live = 0.2,
        delay: float | Live = 0.1,
        cutoff: float | Live = 6.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, moment: Operand = ...) -> Signal: ...
class DelayedOutputFeedback(_Delayed, Block):
    gain: Param[float]
    delay: Param[float]
    cutoff: Param[float]
    left_angle: Input
    right_angle: Input
    left_torque: Output
    right_torque: Output
    def __init__(
        self,
        gain: float | Live = 8.0,
        delay: float | Live = 0.25,
        cutoff: float | Live = 6.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        left_torque: Signal
        right_torque: Signal
    def __call__(self, left_angle: Operand = ..., right_angle: Operand = ...) -> Outputs: ...
class StanceSwingImpedance(Block):
    stiffness: Param[float]
    equilibrium: Param[float]
    stance_damping: Param[float]
    swing_damping: Param[float]
    toe_off: Param[float]
    transition: Param[float]
    phase: Input
    position: Input
    velocity: Input
    enable: Input
    torque: Output
    share: Memory
    def __init__(
        self,
        stiffness: float | Live = 30.0,
        equilibrium: float | Live = 0.1,
        stance_damping: float | Live = 0.0,
        swing_damping: float | Live = 0.3,
        toe_off: float | Live = 0.6,
        transition: float | Live = 0.05,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        phase: Operand = ...,
        position: Operand = ...,
        velocity: Operand = ...,
        enable: Operand = ...,
    ) -> Signal: ...
