# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

WINDOW_SAMPLES_LIMIT: int
def samples_in(window: float, dt: float) -> int: ...
class _Sums(Block):
    window: Param[float]
    u: Input
    samples: Any
    sums: Any
    def __init__(self, window: float = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> _Sums: ...
class MovingAverage(_Sums):
    y: Output
    samples: Memory
    sums: Memory
    place: Memory
    def __init__(self, window: float = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class MovingRMS(_Sums):
    y: Output
    samples: Memory
    sums: Memory
    place: Memory
    def __init__(self, window: float = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class _Extreme(Block):
    window: Param[float]
    u: Input
    values: Any
    steps: Any
    queue: Any
    def __init__(self, window: float = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> _Extreme: ...
class MovingMaximum(_Extreme):
    y: Output
    values: Memory
    steps: Memory
    queue: Memory
    now: Memory
    def __init__(self, window: float = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class MovingMinimum(_Extreme):
    y: Output
    values: Memory
    steps: Memory
    queue: Memory
    now: Memory
    def __init__(self, window: float = 1.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
