# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, Literal, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

MODES: tuple[Any, ...]
class GaitState(Block):
    still_velocity: Param[float]
    still_time: Param[float]
    tolerance: Param[float]
    left_phase: Input
    right_phase: Input
    left_walking: Input
    right_walking: Input
    left_velocity: Input
    right_velocity: Input
    state: Output
    walking: Output
    standing: Output
    confidence: Output
    track: Memory
    def __init__(
        self,
        still_velocity: float | Live = 0.25,
        still_time: float | Live = 0.15,
        tolerance: float | Live = 0.15,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        state: Signal
        walking: Signal
        standing: Signal
        confidence: Signal
    def __call__(
        self,
        left_phase: Operand = ...,
        right_phase: Operand = ...,
        left_walking: Operand = ...,
        right_walking: Operand = ...,
        left_velocity: Operand = ...,
        right_velocity: Operand = ...,
    ) -> Outputs: ...
class StrideEnvelope(Block):
    deviations: Param[float]
    smallest: Param[float]
    strides: Param[int]
    outside_time: Param[float]
    recovery: Param[float]
    phase: Input
    u: Input
    walking: Input
    inside: Output
    deviation: Output
    means: Memory
    variances: Memory
    counts: Memory
    track: Memory
    def __init__(
        self,
        deviations: float | Live = 4.0,
        smallest: float | Live = 0.15,
        strides: int | Live = 5,
        outside_time: float | Live = 0.04,
        recovery: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        inside: Signal
        deviation: Signal
    def __call__(self, phase: Operand = ..., u: Operand = ..., walking: Operand = ...) -> Outputs: ...
class TorqueGate(Block):
    mode: Param[Literal['zero', 'damping', 'hold']]
    fade_in: Param[float]
    fade_out: Param[float]
    damping: Param[float]
    limit: Param[float]
    u: Input
    enable: Input
    velocity: Input
    y: Output
    mode_number: Memory
    track: Memory
    def __init__(
        self,
        mode: Literal['zero', 'damping', 'hold'] = 'zero',
        fade_in: float | Live = 0.5,
        fade_out: float | Live = 0.1,
        damping: float | Live = 1.0,
        limit: float | Live = 5.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ..., enable: Operand = ..., velocity: Operand = ...) -> Signal: ...
