# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand
from typing import Any
from blocks.i2c import I2cDevice
from graph import Input, Memory, Param

FIELD: tuple[Any, ...]
class _Emulated(I2cDevice):
    address: Param[int]
    rate: Param[float]
    accel_range: Param[int]
    gyro_range: Param[int]
    magnetometer: Param[bool]
    accel: Input
    gyro: Input
    mag: Input
    temperature: Input
    silent: Input
    stuck: Input
    wrong_address: Input
    mag_overflow: Input
    mag_not_ready: Input
    identity: Memory
    scales: Memory
    periods: Memory
    fuses: Memory
    state: Memory
    scales_of: Any
    mag_rate: Any
    bypass: Any
    mag_address: Any
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 104,
        mux: int = 0,
        channel: int = 0,
        rate: float = 200.0,
        accel_range: int = 8,
        gyro_range: int = 1000,
        magnetometer: bool = True,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        accel: Operand = ...,
        gyro: Operand = ...,
        mag: Operand = ...,
        temperature: Operand = ...,
        silent: Operand = ...,
        stuck: Operand = ...,
        wrong_address: Operand = ...,
        mag_overflow: Operand = ...,
        mag_not_ready: Operand = ...,
    ) -> _Emulated: ...
    @classmethod
    def of(cls, imu, **parameters): ...
class EmulatedMPU9250(_Emulated):
    adjustment: Param[Sequence[Any] | np.ndarray]
    bypass: Param[bool]
    mag_scale: Any
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 104,
        mux: int = 0,
        channel: int = 0,
        rate: float = 200.0,
        accel_range: int = 8,
        gyro_range: int = 1000,
        magnetometer: bool = True,
        adjustment: Sequence[Any] | np.ndarray = ...,
        bypass: bool = True,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        accel: Operand = ...,
        gyro: Operand = ...,
        mag: Operand = ...,
        temperature: Operand = ...,
        silent: Operand = ...,
        stuck: Operand = ...,
        wrong_address: Operand = ...,
        mag_overflow: Operand = ...,
        mag_not_ready: Operand = ...,
    ) -> EmulatedMPU9250: ...
    def factory_registers(self) -> dict[tuple[int, int], bytes]: ...
class EmulatedICM20948(_Emulated):
    mag_scale: Any
    def __init__(
        self,
        bus: str = 'i2c',
        address: int = 104,
        mux: int = 0,
        channel: int = 0,
        rate: float = 200.0,
        accel_range: int = 8,
        gyro_range: int = 1000,
        magnetometer: bool = True,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        accel: Operand = ...,
        gyro: Operand = ...,
        mag: Operand = ...,
        temperature: Operand = ...,
        silent: Operand = ...,
        stuck: Operand = ...,
        wrong_address: Operand = ...,
        mag_overflow: Operand = ...,
        mag_not_ready: Operand = ...,
    ) -> EmulatedICM20948: ...
    def factory_registers(self) -> dict[tuple[int, int], bytes]: ...
