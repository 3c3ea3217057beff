# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from collections.abc import Callable
from typing import Any
from blocks.i2c import I2cDevice, Identity, Round, Write
from graph import Input, Memory, Output, Param

POWER: int
CONTROL_1: int
CONTROL_2: int
COUNTS: int
CONVERTER: int
POWER_2: int
REVISION: int
RESET: int
DIGITAL: int
ANALOGUE: int
STARTED: int
INTERNAL_SUPPLY: int
CALIBRATE: int
CALIBRATION_FAILED: int
CHOPPER_OFF: int
CAPACITOR_ON: int
GAINS: tuple[Any, ...]
RATES: dict[Any, Any]
SUPPLIES: dict[Any, Any]
CALIBRATION_TIME: float
SPAN: float
class NAU7802(I2cDevice):
    address: Param[int]
    timeout: Param[float]
    rate: Param[int]
    gain: Param[int]
    supply: Param[float]
    capacity: Param[float]
    sensitivity: Param[float]
    scale: Param[float]
    tare_at_start: Param[bool]
    tare_time: Param[float]
    tare: Input
    counts: Output
    ratio: Output
    force: Output
    age: Output
    errors: Output
    identity: Memory
    scales: Memory
    taring: Memory
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 42,
        mux: int = 0,
        channel: int = 0,
        timeout: float = 0.5,
        rate: int = 80,
        gain: int = 128,
        supply: float = 3.0,
        capacity: float = 100.0,
        sensitivity: float = 0.002,
        scale: float = 0.0,
        tare_at_start: bool = True,
        tare_time: float = 0.5,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        counts: Signal
        ratio: Signal
        force: Signal
        age: Signal
        errors: Signal
    def __call__(self, tare: Operand = ...) -> Outputs: ...
    def identities(self) -> tuple[Identity, ...]: ...
    @property
    def control_1(self) -> int: ...
    def set_up(self) -> tuple[Write, ...]: ...
    def learn(self, read: Callable[..., Any], write: Callable[..., Any] | None) -> None: ...
    def check(self) -> tuple[int, bytes]: ...
    def rounds(self) -> tuple[Round, ...]: ...
    def emulator(self, **parameters: Any) -> EmulatedNAU7802: ...
class EmulatedNAU7802(I2cDevice):
    address: Param[int]
    rate: Param[int]
    gain: Param[int]
    capacity: Param[float]
    sensitivity: Param[float]
    scale: Param[float]
    ratio: Input
    force: Input
    silent: Input
    stuck: Input
    wrong_address: Input
    not_ready: Input
    identity: Memory
    layout: Memory
    state: Memory
    name: Any
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 42,
        mux: int = 0,
        channel: int = 0,
        rate: int = 80,
        gain: int = 128,
        capacity: float = 100.0,
        sensitivity: float = 0.002,
        scale: float = 0.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        ratio: Operand = ...,
        force: Operand = ...,
        silent: Operand = ...,
        stuck: Operand = ...,
        wrong_address: Operand = ...,
        not_ready: Operand = ...,
    ) -> EmulatedNAU7802: ...
    @classmethod
    def of(cls, amplifier: NAU7802, **parameters: Any) -> EmulatedNAU7802: ...
