# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
from blocks.i2c import I2cDevice, Round, Write
from graph import Input, Memory, Output, Param

CONVERSION: int
CONFIG: int
INPUTS: dict[Any, Any]
RANGES: dict[Any, Any]
RATES: dict[Any, Any]
START: int
SINGLE: int
NO_COMPARATOR: int
CLOCK_RATE_MINIMUM: float
WAKE_UP_TIME: float
ADDRESSES: tuple[Any, ...]
class ADS1115(I2cDevice):
    address: Param[int]
    timeout: Param[float]
    channels: Param[Sequence[Any] | np.ndarray]
    full_scale: Param[float]
    rate: Param[int]
    a0: Output
    a1: Output
    a2: Output
    a3: Output
    age: Output
    errors: Output
    identity: Memory
    layout: Memory
    channel_names: Any
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 72,
        mux: int = 0,
        channel: int = 0,
        timeout: float = 0.5,
        channels: Sequence[Any] | np.ndarray = ...,
        full_scale: float = 4.096,
        rate: int = 860,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self) -> Any: ...
    def check_channels(self) -> None: ...
    def configuration(self, name: str) -> int: ...
    @property
    def period(self) -> float: ...
    def start(self, name: str) -> Write: ...
    def set_up(self) -> tuple[Write, ...]: ...
    def rounds(self) -> tuple[Round, ...]: ...
    def emulator(self, **parameters: Any) -> EmulatedADS1115: ...
class EmulatedADS1115(I2cDevice):
    address: Param[int]
    channels: Param[Sequence[Any] | np.ndarray]
    full_scale: Param[float]
    rate: Param[int]
    a0: Input
    a1: Input
    a2: Input
    a3: Input
    silent: Input
    stuck: Input
    wrong_address: Input
    not_ready: Input
    identity: Memory
    layout: Memory
    state: Memory
    name: Any
    check_channels: Any
    configuration: Any
    period: Any
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 72,
        mux: int = 0,
        channel: int = 0,
        channels: Sequence[Any] | np.ndarray = ...,
        full_scale: float = 4.096,
        rate: int = 860,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, *signals: Operand, **named: Operand) -> EmulatedADS1115: ...
    @classmethod
    def of(cls, converter: ADS1115, **parameters: Any) -> EmulatedADS1115: ...
def input_description(name: str) -> str: ...
