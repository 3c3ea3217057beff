# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from blocks.gpio import GpioLine
from graph import Input, Memory, Output, Param, StreamDevice

MESSAGE_BYTES: int
LINE_LOAD_LIMIT: float
def message(number): ...
class ChargePump(GpioLine, StreamDevice):
    protects: Param[Sequence[Any] | np.ndarray]
    hold: Param[float]
    start_up: Param[float]
    port: Param[str]
    serial: Param[str]
    baudrate: Param[int]
    changes: Output
    fault: Output
    messages: Memory
    def __init__(
        self,
        chip: str = '/dev/gpiochip0',
        pin: str = '',
        active_low: bool = False,
        protects: Sequence[Any] | np.ndarray = ...,
        hold: float = 0.1,
        start_up: float = 1.0,
        port: str = '',
        serial: str = '',
        baudrate: int = 115200,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        changes: Signal
        fault: Signal
    def __call__(self) -> Outputs: ...
    def opening(self): ...
    def relay_frames(self): ...
    def holds_power_of(self, device): ...
    def fault_in_words(self, code): ...
    def emulator(self, **parameters): ...
class EmulatedChargePump(StreamDevice):
    hold: Param[float]
    messages: Param[int]
    lost: Input
    holds: Output
    changes: Output
    state: Memory
    buffer: Memory
    def __init__(
        self,
        hold: float = 0.1,
        messages: int = 0,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        holds: Signal
        changes: Signal
    def __call__(self, lost: Operand = ...) -> Outputs: ...
    @classmethod
    def of(cls, pump, **parameters): ...
