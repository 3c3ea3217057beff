# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any
from blocks.i2c import I2cDevice
from graph import Memory, Output, Param

FULL: float
ACCEL_RANGES: tuple[Any, ...]
GYRO_RANGES: tuple[Any, ...]
MAG_RATE: float
AK8963_SCALE: float
AK09916_SCALE: float
AK8963_WHO_AM_I: int
AK8963_ADJUSTMENT: int
AK09916_WHO_AM_I: int
UNADJUSTED: bytes
class InvenSense(I2cDevice):
    address: Param[int]
    rate: Param[float]
    accel_range: Param[int]
    gyro_range: Param[int]
    magnetometer: Param[bool]
    calibration: Param[str]
    accel: Output
    gyro: Output
    mag: Output
    temperature: Output
    age: Output
    mag_age: Output
    mag_overflow: Output
    repeated: Output
    errors: Output
    identity: Memory
    scales: Memory
    accel_map: Memory
    gyro_bias: Memory
    mag_map: Memory
    seen: Memory
    mag_address: Any
    mag_scale: Any
    bypass: Any
    def scales_of(self) -> tuple[float, float, float]: ...
    def chips(self) -> tuple[int, ...]: ...
    @property
    def mag_rate(self) -> float: ...
class Bypass:
    bypass: Any
