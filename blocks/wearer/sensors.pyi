# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
import numpy as np
from graph import Block, Input, Memory, Output, Param

class SegmentIMU(Block):
    along: Param[float]
    forward: Param[float]
    mounting: Param[Sequence[Any] | np.ndarray]
    accel_bias: Param[Sequence[Any] | np.ndarray]
    gyro_bias: Param[Sequence[Any] | np.ndarray]
    accel_noise: Param[float]
    gyro_noise: Param[float]
    gyro_drift: Param[float]
    seed: Param[int]
    motion: Input
    accel: Output
    gyro: Output
    quaternion: Output
    rotation: Memory
    accel_offset: Memory
    gyro_offset: Memory
    drift: Memory
    def __init__(
        self,
        along: float | Live = 0.0,
        forward: float | Live = 0.0,
        mounting: Sequence[Any] | np.ndarray = ...,
        accel_bias: Sequence[Any] | np.ndarray = ...,
        gyro_bias: Sequence[Any] | np.ndarray = ...,
        accel_noise: float | Live = 0.0,
        gyro_noise: float | Live = 0.0,
        gyro_drift: float | Live = 0.0,
        seed: int = 0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        accel: Signal
        gyro: Signal
        quaternion: Signal
    def __call__(self, motion: Operand = ...) -> Outputs: ...
class SoleForce(Block):
    length: Param[float]
    heel_at: Param[float]
    forefoot_at: Param[float]
    forefoot_strike: Param[float]
    gain: Param[float]
    zero: Param[float]
    zero_drift: Param[float]
    noise: Param[float]
    dropped: Param[float]
    dropout: Param[float]
    seed: Param[int]
    ground_force: Input
    centre_of_pressure: Input
    phase: Input
    force: Output
    centre: Output
    heel: Output
    forefoot: Output
    drift: Memory
    lost: Memory
    def __init__(
        self,
        length: float | Live = 0.258,
        heel_at: float | Live = 0.15,
        forefoot_at: float | Live = 0.75,
        forefoot_strike: float | Live = 0.0,
        gain: float | Live = 1.0,
        zero: float | Live = 0.0,
        zero_drift: float = 0.0,
        noise: float | Live = 0.0,
        dropped: float | Live = 0.0,
        dropout: float | Live = 0.0,
        seed: int = 0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        force: Signal
        centre: Signal
        heel: Signal
        forefoot: Signal
    def __call__(
        self,
        ground_force: Operand = ...,
        centre_of_pressure: Operand = ...,
        phase: Operand = ...,
    ) -> Outputs: ...
def from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]: ...
