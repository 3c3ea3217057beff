"""Common parts of these IMUs: ports, parameters, scales, and the calibration applied to measurements."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from blocks.controllers.joint import GRAVITY
from blocks.i2c import I2cDevice
from blocks.imus.calibration import Calibration
from graph import Interval, Memory, Output, Param

FULL = 32768.0  # codes of the range
ACCEL_RANGES, GYRO_RANGES = (2, 4, 8, 16), (250, 500, 1000, 2000)  # g and °/s; the index is the code
MAG_RATE = 100.0  # Hz, the fastest of both magnetometers
AK8963_SCALE, AK09916_SCALE = 4912.0 / 32760.0, 0.15  # µT per code of either magnetometer
AK8963_WHO_AM_I, AK8963_ADJUSTMENT, AK09916_WHO_AM_I = 0x00, 0x10, 0x01  # registers
UNADJUSTED = b"\x80\x80\x80"  # neutral factory adjustment of an AK8963


class InvenSense(I2cDevice):
    """Ports and parameters of an IMU whose magnetometer is read separately from its other sensors."""

    abstract = True
    address = Param(
        0x68,
        "1",
        "I2C address: 0x68 with pin AD0 low, 0x69 with pin AD0 high",
        min=0x08,
        max=0x77,
        fixed=True,
        kernel=False,
    )
    rate = Param(
        200.0,
        "Hz",
        "sampling rate; the magnetometer is read at up to 100 Hz",
        above=0.0,
        max=1000.0,
        fixed=True,
        kernel=False,
    )
    accel_range = Param(8, "1", "full-scale acceleration in g", choices=ACCEL_RANGES, fixed=True, kernel=False)
    gyro_range = Param(1000, "1", "full-scale angular rate in °/s", choices=GYRO_RANGES, fixed=True, kernel=False)
    magnetometer = Param(True, "1", "whether the magnetometer is read", fixed=True, kernel=False)
    calibration = Param(
        "", "1", "path of the TOML file that `calibrate` wrote for this sensor; empty for none", dtype=str, file=True
    )

    accel = Output("m/s²", "specific force: +g upwards at rest", shape=(3,))
    gyro = Output("rad/s", "angular rate", shape=(3,))
    mag = Output("µT", "magnetic field, along the axes of the accelerometer", shape=(3,))
    temperature = Output("°C", "temperature of the chip")
    age = Output("s", "time since accel and gyro were measured")
    mag_age = Output("s", "time from the newest magnetometer sample to the newest sample of accel and gyro")
    mag_overflow = Output(
        "1", "whether the field exceeds the range of the magnetometer; mag then keeps its last value", dtype=bool
    )
    repeated = Output(
        "1", "number of consecutive replies equal to the one before, bit for bit, as from a stuck sensor", dtype=int
    )
    errors = Output("1", "number of transfers that failed since the start of the run", dtype=int)

    identity = Memory(0.0, "bus segment and address")
    scales = Memory((0.0,) * 3, "m/s², rad/s and µT per code")
    accel_map = Memory((0.0,) * 12, "calibration: matrix, and the offset subtracted before it")
    gyro_bias = Memory((0.0,) * 3, "gyroscope bias in rad/s")
    mag_map = Memory((0.0,) * 12, "calibration: matrix, and the offset subtracted before it")
    seen = Memory((0.0,) * 4, "time of the newest sample, 1 if there is one, time of the newest magnetometer sample")

    hardware = (*I2cDevice.hardware, "calibration")
    known_addresses = (0x68, 0x69)
    mag_address = 0x0C
    mag_scale = 0.0  # µT per code
    bypass = True  # whether the bus reads the magnetometer directly

    def configure(self) -> None:
        super().configure()
        self.identity = self.own_identity()
        self.scales = self.scales_of()
        found = Calibration.read(self.calibration) if self.calibration else Calibration()
        self.accel_map = (*np.ravel(found.accel_matrix), *found.accel_offset)
        self.gyro_bias = found.gyro_bias
        self.mag_map = (*np.ravel(found.mag_matrix), *found.mag_offset)

    def scales_of(self) -> tuple[float, float, float]:
        """Return the values of one count: acceleration in m/s², angular velocity in rad/s, magnetic field."""
        return self.accel_range * GRAVITY / FULL, math.radians(self.gyro_range) / FULL, self.mag_scale

    def chips(self) -> tuple[int, ...]:
        return (self.address, self.mag_address) if self.magnetometer and self.bypass else (self.address,)

    @property
    def mag_rate(self) -> float:
        """Return the sampling rate of the magnetometer in Hz; 0 without one."""
        return min(self.rate, MAG_RATE) if self.magnetometer else 0.0

    def output_range(self) -> dict[str, Interval]:
        def reach(map: Sequence[float], most: float) -> float:
            matrix, offset = np.reshape(map[:9], (3, 3)), np.array(map[9:])
            return float(np.max(np.abs(matrix) @ (most + np.abs(offset))))

        accel = reach(self.accel_map, FULL * self.scales[0])
        gyro = FULL * self.scales[1] + max(map(abs, self.gyro_bias))
        mag = reach(self.mag_map, 1.5 * FULL * self.mag_scale)  # an adjustment is 1.5 at most
        return {
            "accel": Interval(-accel, accel),
            "gyro": Interval(-gyro, gyro),
            "mag": Interval(-mag, mag),
            "temperature": Interval(-78.0, 120.0),
            "age": Interval(0.0),
            "mag_age": Interval(0.0),
            "mag_overflow": Interval(0.0, 1.0),
            "repeated": Interval(0.0),
            "errors": Interval(0.0),
        }


class Bypass:
    """Parameter of an MPU-9250, shared by its block and its emulator."""

    bypass = Param(
        True,
        "1",
        "whether the magnetometer is read directly from the bus; False: the chip reads it, as required for two IMUs on "
        "one bus segment",
        fixed=True,
        kernel=False,
    )
