# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from graph.device import Device, Sequence
from typing import Any, TYPE_CHECKING as TYPE_CHECKING
from blocks.gpio import GpioLine
from graph import Input, Memory, Output, Param, StreamDevice

MESSAGE_BYTES: int
LINE_LOAD_LIMIT: float
def message(number: Any) -> Any: ...
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
    def opening(self) -> Any: ...
    def relay_frames(self) -> Sequence[bytes]: ...
    def holds_power_of(self, device: Device) -> bool: ...
    def fault_in_words(self, code: int) -> str: ...
    def emulator(self, **parameters: Any) -> EmulatedChargePump: ...
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
    def of(cls, pump: ChargePump, **parameters: Any) -> EmulatedChargePump: ...
