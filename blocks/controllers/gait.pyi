# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
import numpy as np
from graph import Block, Input, Memory, Output, Param

class TorqueProfile(Block):
    points: Param[Sequence[Any] | np.ndarray]
    scale: Param[float]
    phase: Input
    enable: Input
    torque: Output
    knots: Memory
    cubics: Memory
    bounds: Memory
    def __init__(
        self,
        points: Sequence[Any] | np.ndarray = ...,
        scale: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, phase: Operand = ..., enable: Operand = ...) -> Signal: ...
def monotone_cubics(knots: np.ndarray, values: np.ndarray) -> np.ndarray: ...
class GaitPhase(Block):
    threshold: Param[float]
    event_phase: Param[float]
    shortest: Param[float]
    longest: Param[float]
    angle: Input
    velocity: Input
    phase: Output
    walking: Output
    stride_time: Output
    strides: Output
    elapsed: Memory
    armed: Memory
    mean: Memory
    valid: Memory
    events: Memory
    def __init__(
        self,
        threshold: float | Live = 0.7,
        event_phase: float | Live = 0.62,
        shortest: float | Live = 0.6,
        longest: float | Live = 2.5,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        phase: Signal
        walking: Signal
        stride_time: Signal
        strides: Signal
    def __call__(self, angle: Operand = ..., velocity: Operand = ...) -> Outputs: ...
