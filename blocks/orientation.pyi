# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Output, Param

class Ahrs:
    gyro: Any
    accel: Any
    mag: Any
    quaternion: Any
    state: Any
class Madgwick(Ahrs, Block):
    gain: Param[float]
    def __init__(self, gain: float | Live = 0.1, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, gyro: Operand = ..., accel: Operand = ..., mag: Operand = ...) -> Signal: ...
class Mahony(Ahrs, Block):
    kp: Param[float]
    ki: Param[float]
    bias: Output
    def __init__(self, kp: float | Live = 1.0, ki: float | Live = 0.02, **options: Unpack[BlockOptions]) -> None: ...
    class Outputs(NamedTuple):
        quaternion: Signal
        bias: Signal
    def __call__(self, gyro: Operand = ..., accel: Operand = ..., mag: Operand = ...) -> Outputs: ...
class ComplementaryOrientation(Ahrs, Block):
    time_constant: Param[float]
    def __init__(self, time_constant: float | Live = 2.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, gyro: Operand = ..., accel: Operand = ..., mag: Operand = ...) -> Signal: ...
