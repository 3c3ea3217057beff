# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from collections.abc import Sequence
from graph import Block, Memory, Output, Param

class StateMachine(Block):
    takes: Param[dict[Any, Any]]
    gives: Param[dict[Any, Any]]
    states: Param[dict[Any, Any]]
    transitions: Param[Sequence[Any] | np.ndarray]
    initial: Param[str]
    state: Output
    time_in_state: Output
    table: Memory
    code: Memory
    values: Memory
    current: Memory
    names: Any
    def __init__(
        self,
        takes: dict[Any, Any] = ...,
        gives: dict[Any, Any] = ...,
        *,
        states: dict[Any, Any],
        transitions: Sequence[Any] | np.ndarray = ...,
        initial: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self, *signals: Operand, **named: Operand) -> Any: ...
    def check_states(self, outputs: dict[str, Output]) -> None: ...
    def index(self, state: str, where: str) -> float: ...
_BINARY: dict[Any, Any]
_COMPARE: dict[Any, Any]
def compile_condition(text: str, inputs: Sequence[str]) -> list[tuple[float, float]]: ...
_UNARY: Any
