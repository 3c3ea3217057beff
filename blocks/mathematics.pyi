# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from blocks._plumbing.ports import UnitOfOutput
from graph import Block, Input, Memory, Output, Param
from graph.arithmetic import Divide as Divide, Gain as Gain, Product as Product, Sum as Sum, UnitConversion as UnitConversion

class Abs(Block):
    u: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Sign(Block):
    u: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Min(Block):
    count: Param[int]
    y: Output
    def __init__(self, count: int = 2, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Max(Block):
    count: Param[int]
    y: Output
    def __init__(self, count: int = 2, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Round(Block):
    method: Param[Literal['nearest', 'floor', 'ceil']]
    u: Input
    y: Output
    def __init__(
        self,
        method: Literal['nearest', 'floor', 'ceil'] = 'nearest',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class SquareRoot(Block):
    u: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Power(Block):
    exponent: Param[float]
    u: Input
    y: Output
    def __init__(self, exponent: float | Live = 2.0, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Polynomial(UnitOfOutput, Block):
    coefficients: Param[Sequence[Any] | np.ndarray]
    unit: Param[str]
    u: Input
    y: Output
    terms: Memory
    def __init__(
        self,
        coefficients: Sequence[Any] | np.ndarray = ...,
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
def power(x: float, p: float) -> float: ...
def unit_to_the(unit: str, exponent: float) -> str: ...
