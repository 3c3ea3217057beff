"""Emulated IMUs of InvenSense, with the same bytes as the real ones."""

from typing import Any

from blocks.controllers.joint import GRAVITY
from blocks.i2c import I2cDevice
from blocks.imus.invensense.ports import (
    AK09916_SCALE,
    AK09916_WHO_AM_I,
    AK8963_ADJUSTMENT,
    AK8963_SCALE,
    AK8963_WHO_AM_I,
    UNADJUSTED,
    Bypass,
    InvenSense,
)
from cext.kernels import no_io
from cext.kernels.devices.invensense import chips as kernels
from graph import Input, Memory, Param

FIELD = (20.0, 0.0, -44.0)  # µT, as in central Europe: north and down


class _Emulated(I2cDevice):
    """Ports, parameters and faults of an emulated IMU.

    It replies at the rates of the block's transfers, and is at rest by default.
    """

    address = InvenSense.parameters["address"]
    rate = InvenSense.parameters["rate"]
    accel_range = InvenSense.parameters["accel_range"]
    gyro_range = InvenSense.parameters["gyro_range"]
    magnetometer = InvenSense.parameters["magnetometer"]

    accel = Input("m/s²", "specific force along the axes of the chip", shape=(3,), default=(0.0, 0.0, GRAVITY))
    gyro = Input("rad/s", "angular rate about the axes of the chip", shape=(3,), default=(0.0, 0.0, 0.0))
    mag = Input("µT", "magnetic field, along the axes of the accelerometer", shape=(3,), default=FIELD)
    temperature = Input("°C", "temperature of the chip", default=30.0)
    silent = Input("1", "whether the chip sends no reply", default=False, dtype=bool)
    stuck = Input("1", "whether every reply repeats the same bytes", default=False, dtype=bool)
    wrong_address = Input("1", "address used instead of `address`; 0 for none", default=0, dtype=int)
    mag_overflow = Input(
        "1", "whether the magnetometer reports that the field exceeds its range", default=False, dtype=bool
    )
    mag_not_ready = Input("1", "whether the magnetometer has no new sample", default=False, dtype=bool)

    identity = Memory(0.0, "bus segment and address")
    scales = Memory((0.0,) * 3, "m/s², rad/s and µT per code")
    periods: Memory = Memory(
        (0.0,) * 3, "period in s of the replies and of the magnetometer's, 0 for never; 1 if both are one reply"
    )
    fuses = Memory((128.0,) * 3, "factory adjustment of the magnetometer")
    state = Memory((0.0,) * 7, "times of the next replies, and the values repeated while stuck")

    timeout: Any = 0.0  # nothing replies to an emulator
    decode = no_io.ignore_all
    scales_of, mag_rate = InvenSense.scales_of, InvenSense.mag_rate
    bypass = True
    known_addresses, mag_address, chips = InvenSense.known_addresses, InvenSense.mag_address, InvenSense.chips

    @classmethod
    def of(cls, imu: InvenSense, **parameters: Any) -> Any:
        """Return the emulator of a robot's block."""
        return cls(**{name: getattr(imu, name) for name in cls.parameters if name in type(imu).parameters} | parameters)

    def configure(self) -> None:
        super().configure()
        self.identity = self.own_identity()
        self.scales = self.scales_of()
        self.periods = (1.0 / self.rate, 1.0 / self.mag_rate if self.magnetometer else 0.0, 0.0)


class EmulatedMPU9250(_Emulated):
    """Emulated MPU-9250: sends the content of its registers at the rate of its block's transfers. At rest by default.

    `EmulatedMPU9250.of(robot["left/shank_imu"])` emulates the IMU of a robot. With every fault input at zero, it is
    healthy.
    """

    adjustment = Param(
        tuple(UNADJUSTED),
        "1",
        "factory adjustment (ASA) of the magnetometer: three bytes, one per axis",
        dtype=tuple,
        fixed=True,
    )

    bypass = Bypass.bypass

    encode = kernels.mpu_answers
    mag_scale = AK8963_SCALE

    def configure(self) -> None:
        super().configure()
        if len(self.adjustment) != 3 or not all(isinstance(byte, int) and 0 <= byte <= 255 for byte in self.adjustment):
            raise ValueError(f"adjustment: expected three integers from 0 to 255, got {self.adjustment!r}")
        self.fuses = tuple(map(float, self.adjustment))
        self.periods = (*self.periods[:2], float(self.magnetometer and not self.bypass))

    def factory_registers(self) -> dict[tuple[int, int], bytes]:
        return {
            (self.mag_address, AK8963_WHO_AM_I): b"\x48",
            (self.mag_address, AK8963_ADJUSTMENT): bytes(self.adjustment),
        }


class EmulatedICM20948(_Emulated):
    """Emulated ICM-20948: sends the content of its registers at the rate of its block's transfers. At rest by default.

    `EmulatedICM20948.of(robot["left/shank_imu"])` emulates the IMU of a robot. With every fault input at zero, it is
    healthy.
    """

    encode = kernels.icm_answers
    mag_scale = AK09916_SCALE

    def factory_registers(self) -> dict[tuple[int, int], bytes]:
        return {(self.mag_address, AK09916_WHO_AM_I): b"\x09"}
