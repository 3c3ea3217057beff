"""What these IMUs share: ports, parameters, scales, and the calibration that is laid over what they measure."""

from __future__ import annotations

import math

import numpy as np

from blocks.controllers.joint import GRAVITY
from blocks.i2c import I2cDevice
from blocks.imus.calibration import Calibration
from graph import Interval, Memory, Output, Param

FULL = 32768.0  # codes of the range
ACCEL_RANGES, GYRO_RANGES = (2, 4, 8, 16), (250, 500, 1000, 2000)  # g and °/s; the place is the code
MAG_RATE = 100.0  # Hz, the fastest of both magnetometers
AK8963_SCALE, AK09916_SCALE = 4912.0 / 32760.0, 0.15  # µT of a code of either magnetometer
UNADJUSTED = b"\x80\x80\x80"  # factory adjustment of an AK8963 that changes nothing


class InvenSense(I2cDevice):
    """Ports and parameters of an IMU with a burst of accelerometer, gyroscope and temperature, and a magnetometer
    beside it.
    """

    abstract = True
    address = Param(
        0x68, "1", "its address: 0x69 where its pin AD0 is high", min=0x08, max=0x77, fixed=True, kernel=False
    )
    rate = Param(
        200.0,
        "Hz",
        "at which it is read; the magnetometer at 100 Hz at most",
        above=0.0,
        max=1000.0,
        fixed=True,
        kernel=False,
    )
    accel_range = Param(8, "1", "g that it measures at most", choices=ACCEL_RANGES, fixed=True, kernel=False)
    gyro_range = Param(1000, "1", "°/s that it measures at most", choices=GYRO_RANGES, fixed=True, kernel=False)
    magnetometer = Param(True, "1", "whether its magnetometer is read", fixed=True, kernel=False)
    calibration = Param(
        "", "1", "TOML file that `calibrate` has written for this sensor; empty for none", dtype=str, file=True
    )

    accel = Output("m/s²", "specific force: +g upwards at rest", shape=(3,))
    gyro = Output("rad/s", "angular rate", shape=(3,))
    mag = Output("µT", "magnetic field, along the axes of the accelerometer", shape=(3,))
    temperature = Output("°C", "of the chip")
    age = Output("s", "since accel and gyro were measured")
    mag_age = Output("s", "from the magnetometer's newest measurement to that of accel and gyro")
    mag_overflow = Output("1", "whether the field is too strong; mag keeps its last value", dtype=bool)
    repeated = Output(
        "1", "answers in a row that were the same as the one before, to the last bit: a sensor that is stuck", dtype=int
    )
    errors = Output("1", "transfers that have failed since the run began", dtype=int)

    identity = Memory(0.0, "place and address")
    scales = Memory((0.0,) * 3, "m/s², rad/s and µT of a code")
    accel_map = Memory((0.0,) * 12, "matrix, and what is taken away before it")
    gyro_bias = Memory((0.0,) * 3, "rad/s that is taken away")
    mag_map = Memory((0.0,) * 12, "matrix, and what is taken away before it")
    seen = Memory((0.0,) * 4, "the newest burst, whether there is one, when the magnetometer measured")

    hardware = (*I2cDevice.hardware, "calibration")
    known_addresses = (0x68, 0x69)
    mag_address = 0x0C
    mag_scale = 0.0  # µT of a code
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
        return self.accel_range * GRAVITY / FULL, math.radians(self.gyro_range) / FULL, self.mag_scale

    def chips(self) -> tuple[int, ...]:
        return (self.address, self.mag_address) if self.magnetometer and self.bypass else (self.address,)

    @property
    def mag_rate(self) -> float:
        return min(self.rate, MAG_RATE) if self.magnetometer else 0.0

    def output_range(self) -> dict[str, Interval]:
        def reach(map, most):
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
    """Parameter of an MPU-9250 that its block and its emulator take over."""

    bypass = Param(
        True,
        "1",
        "whether the bus reads the magnetometer directly; otherwise the chip reads it, as two on one piece of bus need",
        fixed=True,
        kernel=False,
    )
