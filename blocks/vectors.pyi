# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from collections.abc import Sequence
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
import numpy as np
from graph import Block, Input, Memory, Output, Param
from graph.arithmetic import Select as Select, Stack as Stack

class Concatenate(Block):
    sizes: Param[Sequence[Any] | np.ndarray]
    y: Output
    def __init__(self, sizes: Sequence[Any] | np.ndarray = ..., **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Signal: ...
class Norm(Block):
    u: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
class Dot(Block):
    a: Input
    b: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, a: Operand = ..., b: Operand = ...) -> Signal: ...
class Cross(Block):
    a: Input
    b: Input
    y: Output
    def __init__(self, **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, a: Operand = ..., b: Operand = ...) -> Signal: ...
class MatrixGain(Block):
    matrix: Param[Sequence[Any] | np.ndarray]
    unit: Param[str]
    u: Input
    y: Output
    entries: Memory
    rows: Any
    def __init__(
        self,
        matrix: Sequence[Any] | np.ndarray = ...,
        unit: str = '1',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
def length(element: Any, count: Any) -> Any: ...
