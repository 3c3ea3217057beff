# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Signal
from collections.abc import Callable
from typing import Any
from blocks.i2c import Identity, Round, Write
from blocks.imus.invensense.emulator import EmulatedMPU9250
from blocks.imus.invensense.ports import InvenSense
from graph import Param

SAMPLE_RATE_DIVIDER: int
CONFIG: int
INTERRUPT_PINS: int
BURST: int
USER_CONTROL: int
POWER: int
WHO_AM_I: int
RESET: int
AUTOMATIC_CLOCK: int
BYPASS: int
MASTER: int
MASTER_CONTROL: int
SLAVE: int
KHZ_400: int
READS: int
ENABLED: int
LOW_PASSES: dict[Any, Any]
INTERNAL_RATE: float
MAG_STATUS: int
MAG_CONTROL: int
MAG_CONTROL_2: int
MAG_POWER_DOWN: int
MAG_FUSES: int
MAG_100_HZ_16_BITS: int
MAG_RESET: int
MAG_BYTES: int
class MPU9250(InvenSense):
    low_pass: Param[int]
    bypass: Param[bool]
    adjustment: Any
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
        low_pass: int = 41,
        bypass: bool = True,
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
    def release(self) -> tuple[Write, ...]: ...
    def settings(self) -> bytes: ...
    def identities(self) -> tuple[Identity, ...]: ...
    def set_up(self) -> tuple[Write, ...]: ...
    def asks_by_itself(self) -> tuple[Write, ...]: ...
    def mag_write(self, register: int, value: int, wait: float) -> Write: ...
    def learn(self, read: Callable[..., Any], write: Callable[..., Any]) -> None: ...
    def check(self) -> tuple[int, bytes]: ...
    def rounds(self) -> tuple[Round, ...]: ...
    def emulator(self, **parameters: Any) -> EmulatedMPU9250: ...
