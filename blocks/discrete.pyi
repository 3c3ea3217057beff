# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class Hold(Block):
    u: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class UnitDelay(Block):
    initial: Param[float]
    u: Input
    y: Output
    held: Memory
    def __init__(self, initial: float = 0.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Delay(Block):
    samples: Param[int]
    initial: Param[float]
    u: Input
    y: Output
    held: Memory
    place: Memory
    def __init__(self, samples: int = 1, initial: float = 0.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Integrator(Block):
    initial: Param[float]
    lower: Param[float]
    upper: Param[float]
    method: Param[Literal['forward', 'backward', 'trapezoidal']]
    u: Input
    restart: Input
    y: Output
    state: Memory
    held: Memory
    def __init__(
        self,
        initial: float = 0.0,
        lower: float | Live = ...,
        upper: float | Live = ...,
        method: Literal['forward', 'backward', 'trapezoidal'] = 'forward',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ..., restart: Operand = ...) -> Signal: ...
class Derivative(Block):
    time_constant: Param[float]
    u: Input
    y: Output
    follower: Memory
    def __init__(self, time_constant: float | Live = 0.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
