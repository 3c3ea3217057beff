# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from collections.abc import Sequence
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from collections.abc import Iterable
from typing import Any
import numpy as np
from graph.block import Block
from graph.declarations import Input, Memory, Output, Param
from graph.signal import Operand, Signal

class Gain(Block):
    gain: Param[float]
    unit: Param[str]
    u: Input
    y: Output
    def __init__(self, gain: float | Live = 1.0, unit: str = '1', **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Sum(Block):
    signs: Param[str]
    y: Output
    weights: Memory
    def __init__(self, signs: str = '++', **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Product(Block):
    a: Input
    b: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, a: Operand = ..., b: Operand = ...) -> Signal: ...
class Divide(Block):
    a: Input
    b: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, a: Operand = ..., b: Operand = ...) -> Signal: ...
class UnitConversion(Block):
    source: Param[str]
    target: Param[str]
    u: Input
    y: Output
    factor: Memory
    offset: Memory
    def __init__(self, source: str, target: str, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Stack(Block):
    count: Param[int]
    shape: Param[Sequence[Any] | np.ndarray]
    y: Output
    def __init__(
        self,
        count: int = 2,
        shape: Sequence[Any] | np.ndarray = ...,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Select(Block):
    index: Param[Any]
    of: Param[Sequence[Any] | np.ndarray | None]
    u: Input
    y: Output
    places: Memory
    indices: Any
    def __init__(
        self,
        index: Any = 0,
        of: Sequence[Any] | np.ndarray | None = None,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
    def plain(self) -> None: ...
def encoded(index: Any) -> Any: ...
def decoded(index: Any) -> Any: ...
def whole_numbers(name: str, values: Iterable[Any], smallest: int | None=1) -> tuple[int, ...]: ...
class Convert(Block):
    target: Param[str]
    u: Input
    y: Output
    factor: Memory
    offset: Memory
    def __init__(self, target: str, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
def stack(*signals: Operand) -> Signal: ...
def _check_open(*operands: Any) -> None: ...
def plus(a: Operand, b: Operand, signs: str='++') -> Signal: ...
def times(signal: Signal, factor: Signal | float) -> Signal: ...
def over(dividend: Any, divisor: Signal | float) -> Signal: ...
