# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class StridePhase(Block):
    count: Param[int]
    shortest: Param[float]
    longest: Param[float]
    strike: Input
    phase: Output
    walking: Output
    stride_time: Output
    state: Memory
    def __init__(
        self,
        count: int | Live = 3,
        shortest: float | Live = 0.5,
        longest: float | Live = 2.5,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        phase: Signal
        walking: Signal
        stride_time: Signal
    def __call__(self, strike: Operand = ...) -> Outputs: ...
class PhasePortrait(Block):
    angle: Input
    velocity: Input
    strike: Input
    phase: Output
    walking: Output
    extremes: Memory
    zero: Memory
    latest: Memory
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    class Outputs(NamedTuple):
        phase: Signal
        walking: Signal
    def __call__(self, angle: Operand = ..., velocity: Operand = ..., strike: Operand = ...) -> Outputs: ...
