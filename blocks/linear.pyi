# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from collections.abc import Sequence
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
import numpy as np
from blocks._plumbing.biquads import Biquads
from graph import Block, Input, Memory, Output, Param

class TransferFunction(Block):
    numerator: Param[Sequence[Any] | np.ndarray]
    denominator: Param[Sequence[Any] | np.ndarray]
    domain: Param[Literal['z', 's']]
    unit: Param[str]
    u: Input
    y: Output
    b: Memory
    a: Memory
    delays: Memory
    rest: Memory
    def __init__(
        self,
        numerator: Sequence[Any] | np.ndarray = ...,
        denominator: Sequence[Any] | np.ndarray = ...,
        domain: Literal['z', 's'] = 'z',
        unit: str = '1',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
    def design(self, dt: Any) -> tuple[tuple[float, ...], tuple[float, ...]]: ...
def polynomial(name: str, coefficients: tuple[float, ...]) -> tuple[float, ...]: ...
def tustin(coefficients: Sequence[float] | np.ndarray, dt: Any) -> np.ndarray: ...
def delays_at_rest(b: tuple[float, ...], a: tuple[float, ...]) -> list[float]: ...
class BiquadCascade(Biquads):
    sos: Param[Sequence[Any] | np.ndarray]
    def __init__(self, sos: Sequence[Any] | np.ndarray = ..., **options: Unpack[BlockOptions]) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
    def design(self, dt: float) -> list[tuple[float, ...]]: ...
class StateSpace(Block):
    A: Param[Sequence[Any] | np.ndarray]
    B: Param[Sequence[Any] | np.ndarray]
    C: Param[Sequence[Any] | np.ndarray]
    D: Param[Sequence[Any] | np.ndarray]
    start: Param[Sequence[Any] | np.ndarray]
    unit: Param[str]
    u: Input
    y: Output
    matrix_a: Memory
    matrix_b: Memory
    matrix_c: Memory
    matrix_d: Memory
    rest: Memory
    state: Memory
    following: Memory
    matrices: Any
    def __init__(
        self,
        A: Sequence[Any] | np.ndarray,
        B: Sequence[Any] | np.ndarray,
        C: Sequence[Any] | np.ndarray,
        D: Sequence[Any] | np.ndarray = ...,
        start: Sequence[Any] | np.ndarray = ...,
        unit: str = '1',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, u: Operand = ...) -> Signal: ...
def matrix(name: str, rows: tuple[tuple[float, ...], ...]) -> np.ndarray: ...
def state_at_rest(A: np.ndarray, B: np.ndarray) -> np.ndarray: ...
def zero_order_hold(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]: ...
