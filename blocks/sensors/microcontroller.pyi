# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
from blocks.sensors import fields
from graph import Input, Memory, Output, Param, StreamDevice

FIELD_BYTES_LIMIT: int
CHECKSUM_BYTES: int
FIELD_NUMBERS_LIMIT: int
PACKET_BYTES_LIMIT: dict[Any, Any]
class Microcontroller(StreamDevice):
    fields: Param[Sequence[Any] | np.ndarray]
    format: Param[Literal['cobs', 'lines']]
    counter: Param[bool]
    clock: Param[str]
    clock_wrap: Param[float]
    port: Param[str]
    serial: Param[str]
    baudrate: Param[int]
    packet_rate: Param[float]
    start: Param[str]
    timeout: Param[float]
    age: Output
    received: Output
    lost: Output
    late: Output
    corrupt: Output
    sample_time: Output
    clock_drift: Output
    plan: Memory
    parsed: Memory
    sequence: Memory
    buffer: Memory
    clock_plan: Memory
    mapped: Memory
    declared: Any
    def __init__(
        self,
        fields: Sequence[Any] | np.ndarray,
        format: Literal['cobs', 'lines'] = 'cobs',
        counter: bool = True,
        clock: str = '',
        clock_wrap: float = 0.0,
        port: str = '',
        serial: str = '',
        baudrate: int = 115200,
        packet_rate: float = 0.0,
        start: str = '',
        timeout: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self) -> Any: ...
    def opening(self) -> dict[str, Any]: ...
    def sends(self) -> list[tuple[float, int]]: ...
    def line_speed(self) -> float: ...
    def emulator(self, **parameters: Any) -> Any: ...
class EmulatedMicrocontroller(StreamDevice):
    fields: Param[Sequence[Any] | np.ndarray]
    format: Param[Literal['cobs', 'lines']]
    counter: Param[bool]
    clock: Param[str]
    clock_wrap: Param[float]
    period: Param[float]
    silent: Input
    dropped: Input
    broken: Input
    plan: Memory
    state: Memory
    waiting: Memory
    clock_plan: Memory
    declared: Any
    def __init__(
        self,
        fields: Sequence[Any] | np.ndarray,
        format: Literal['cobs', 'lines'] = 'cobs',
        counter: bool = True,
        clock: str = '',
        clock_wrap: float = 0.0,
        period: float = 0.005,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> EmulatedMicrocontroller: ...
    @classmethod
    def of(cls, microcontroller: Microcontroller, **parameters: Any) -> EmulatedMicrocontroller: ...
_RESERVED_NAMES: Any
