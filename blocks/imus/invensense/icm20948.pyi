# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Signal
from collections.abc import Callable
from typing import Any
from blocks.i2c import Identity, Round, Write
from blocks.imus.invensense.emulator import EmulatedICM20948
from blocks.imus.invensense.ports import InvenSense
from graph import Param

BANK: int
WHO_AM_I: int
USER_CONTROL: int
POWER: int
POWER_2: int
INTERRUPT_PINS: int
BURST: int
GYRO_DIVIDER: int
GYRO_CONFIG: int
ACCEL_DIVIDER: int
ACCEL_CONFIG: int
RESET: int
AUTOMATIC_CLOCK: int
BYPASS: int
LOW_PASSES: dict[Any, Any]
INTERNAL_RATE: float
FILTERED: int
MAG_STATUS: int
MAG_CONTROL_2: int
MAG_CONTROL_3: int
MAG_100_HZ: int
MAG_RESET: int
MAG_BYTES: int
class ICM20948(InvenSense):
    low_pass: Param[int]
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 104,
        mux: int = 0,
        channel: int = 0,
        timeout: float = 0.1,
        rate: float = 200.0,
        accel_range: int = 8,
        gyro_range: int = 1000,
        magnetometer: bool = True,
        calibration: str = '',
        low_pass: int = 51,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        accel: Signal
        gyro: Signal
        mag: Signal
        temperature: Signal
        age: Signal
        mag_age: Signal
        mag_overflow: Signal
        repeated: Signal
        errors: Signal
    def __call__(self) -> Outputs: ...
    def identities(self) -> tuple[Identity, ...]: ...
    def release(self) -> tuple[Write, Write]: ...
    def set_up(self) -> tuple[Write, ...]: ...
    def learn(self, read: Callable[..., Any], write: Callable[..., Any]) -> None: ...
    def check(self) -> tuple[int, bytes]: ...
    def rounds(self) -> tuple[Round, ...]: ...
    def emulator(self, **parameters: Any) -> EmulatedICM20948: ...
