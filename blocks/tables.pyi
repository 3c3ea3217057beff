# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
import numpy as np
from blocks._plumbing.ports import UnitOfOutput
from graph import Block, Input, Interval, Memory, Output, Param

ROUNDING: float
BEYOND_CHOICES: tuple[Any, ...]
class LookupTable1D(UnitOfOutput, Block):
    breakpoints: Param[Sequence[Any] | np.ndarray]
    values: Param[Sequence[Any] | np.ndarray]
    beyond: Param[Literal['clamp', 'extrapolate', 'error']]
    unit: Param[str]
    u: Input
    y: Output
    knots: Memory
    heights: Memory
    def __init__(
        self,
        breakpoints: Sequence[Any] | np.ndarray = ...,
        values: Sequence[Any] | np.ndarray = ...,
        beyond: Literal['clamp', 'extrapolate', 'error'] = 'clamp',
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
    def near(self, x: float) -> Interval: ...
    def end(self, x: Any) -> Any: ...
    def piece(self, i: int) -> tuple[list[float], list[float]]: ...
class LookupTable2D(UnitOfOutput, Block):
    rows: Param[Sequence[Any] | np.ndarray]
    columns: Param[Sequence[Any] | np.ndarray]
    values: Param[Sequence[Any] | np.ndarray]
    beyond: Param[Literal['clamp', 'extrapolate', 'error']]
    unit: Param[str]
    row: Input
    column: Input
    y: Output
    row_knots: Memory
    column_knots: Memory
    heights: Memory
    def __init__(
        self,
        rows: Sequence[Any] | np.ndarray = ...,
        columns: Sequence[Any] | np.ndarray = ...,
        values: Sequence[Any] | np.ndarray = ...,
        beyond: Literal['clamp', 'extrapolate', 'error'] = 'clamp',
        unit: str = 'any',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, row: Operand = ..., column: Operand = ...) -> Signal: ...
def rising_numbers(name: str, values: tuple[float, ...]) -> np.ndarray: ...
def corners(u: Interval, knots: np.ndarray, extends: bool) -> np.ndarray: ...
def place(knots: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...
