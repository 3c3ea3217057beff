# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
from blocks._plumbing.biquads import Biquads
from graph import Block, Input, Memory, Output, Param

_EDGE: Any
class _Edges(Param[Any]):
    def check(self, value): ...
    def parse(self, text): ...
class Butterworth(Biquads):
    order: Param[int]
    cutoff: Param[Any]
    btype: Param[Literal['lowpass', 'highpass', 'bandpass', 'bandstop']]
    def __init__(
        self,
        order: int = 2,
        cutoff: Any = 10.0,
        btype: Literal['lowpass', 'highpass', 'bandpass', 'bandstop'] = 'lowpass',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
    def design(self, dt: float) -> list[tuple[float, ...]]: ...
class Notch(Biquads):
    frequency: Param[float]
    q: Param[float]
    def __init__(self, frequency: float = 50.0, q: float = 30.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
    def design(self, dt: float) -> list[tuple[float, ...]]: ...
def check_frequency(what: str, frequency: float, dt: float) -> None: ...
class Exponential(Block):
    time_constant: Param[float]
    u: Input
    y: Output
    state: Memory
    def __init__(self, time_constant: float | Live = 0.05, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Median(Block):
    samples: Param[int]
    u: Input
    y: Output
    ring: Memory
    ordered: Memory
    place: Memory
    counts: Memory
    def __init__(self, samples: int = 3, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Complementary(Block):
    time_constant: Param[float]
    rate: Input
    angle: Input
    fused: Output
    state: Memory
    def __init__(self, time_constant: float | Live = 0.5, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, rate: Operand = ..., angle: Operand = ...) -> Signal: ...
