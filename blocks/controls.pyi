# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
from graph import Memory, Output, Param, StreamDevice

KEY: int
AXIS: int
STICK: tuple[Any, ...]
CODES: dict[Any, Any]
class Controls(StreamDevice):
    axes: Param[Sequence[Any] | np.ndarray]
    buttons: Param[Sequence[Any] | np.ndarray]
    device: Param[str]
    dead_zone: Param[float]
    age: Output
    connected: Output
    missed: Output
    plan: Memory
    def __init__(
        self,
        axes: Sequence[Any] | np.ndarray = ...,
        buttons: Sequence[Any] | np.ndarray = ...,
        device: str = '',
        dead_zone: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self) -> Any: ...
    def opening(self) -> dict[str, Any]: ...
    def emulator(self, **parameters: Any) -> Any: ...
class GameController(Controls):
    axes: Param[Sequence[Any] | np.ndarray]
    buttons: Param[Sequence[Any] | np.ndarray]
    axis: Any
    side: Any
    code: Any
    def __init__(
        self,
        axes: Sequence[Any] | np.ndarray = ...,
        buttons: Sequence[Any] | np.ndarray = ...,
        device: str = '',
        dead_zone: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self) -> Any: ...
class Keyboard(Controls):
    buttons: Param[Sequence[Any] | np.ndarray]
    def __init__(
        self,
        axes: Sequence[Any] | np.ndarray = ...,
        buttons: Sequence[Any] | np.ndarray = ...,
        device: str = '',
        dead_zone: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self) -> Any: ...
class EmulatedControls(StreamDevice):
    axes: Param[Sequence[Any] | np.ndarray]
    buttons: Param[Sequence[Any] | np.ndarray]
    plan: Memory
    last: Memory
    def __init__(
        self,
        axes: Sequence[Any] | np.ndarray = ...,
        buttons: Sequence[Any] | np.ndarray = ...,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> EmulatedControls: ...
    @classmethod
    def of(cls, controls: Controls, **parameters: Any) -> EmulatedControls: ...
def declared(block: Any, taken: dict[str, Output]) -> tuple[dict[str, int], tuple[float, ...]]: ...
