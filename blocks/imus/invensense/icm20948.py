"""ICM-20948 and its magnetometer AK09916 on I2C. (DS-000189 1.5.)"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from blocks.i2c import Identity, Read, Round, Transfer, Write
from blocks.imus.invensense.emulator import EmulatedICM20948
from blocks.imus.invensense.ports import ACCEL_RANGES, AK09916_SCALE, AK09916_WHO_AM_I, GYRO_RANGES, InvenSense
from cext.kernels.devices.invensense import chips as kernels
from graph import Param

BANK = 0x7F  # selects the bank of the other registers, << 4
WHO_AM_I, USER_CONTROL, POWER, POWER_2, INTERRUPT_PINS, BURST = 0x00, 0x03, 0x06, 0x07, 0x0F, 0x2D  # bank 0
GYRO_DIVIDER, GYRO_CONFIG, ACCEL_DIVIDER, ACCEL_CONFIG = 0x00, 0x01, 0x10, 0x14  # bank 2
RESET, AUTOMATIC_CLOCK, BYPASS = 0x80, 0x01, 0x02
LOW_PASSES = {197: 0, 152: 1, 120: 2, 51: 3, 24: 4, 12: 5, 6: 6}  # Hz of the gyroscope, code of both filters
INTERNAL_RATE = 1125.0  # Hz, with one of these filters
FILTERED = 0x01

MAG_STATUS, MAG_CONTROL_2, MAG_CONTROL_3 = 0x10, 0x31, 0x32
MAG_100_HZ, MAG_RESET = 0x08, 0x01
MAG_BYTES = 9  # ST1, three axes, one without meaning, ST2


class ICM20948(InvenSense):
    """ICM-20948 on I2C: accelerometer, gyroscope and the magnetometer AK09916.   (DS-000189 1.5)

    The y and z axes of the magnetometer are opposite to those of the accelerometer; `mag` has the axes of the
    accelerometer. mag = raw · 0.15 µT. The magnetometers of two IMUs on one bus segment, 0x68 and 0x69, have the same
    address: connect one IMU behind a multiplexer, or set `magnetometer=False` for it.
    """

    low_pass = Param(
        51,
        "Hz",
        "cut-off of the low-pass of gyroscope and accelerometer",
        choices=tuple(LOW_PASSES),
        fixed=True,
        kernel=False,
    )

    kind = "ICM-20948"
    decode = kernels.icm_decode
    mag_scale = AK09916_SCALE

    def identities(self) -> tuple[Identity, ...]:
        return (Identity(WHO_AM_I, {0xEA: "ICM-20948"}),)

    def release(self) -> tuple[Write, Write]:
        """Disconnect the magnetometer from the bus, so that another with the same address can be configured."""
        return Write(BANK, b"\x00"), Write(INTERRUPT_PINS, b"\x00")

    def set_up(self) -> tuple[Write, ...]:
        code = LOW_PASSES[self.low_pass] << 3 | FILTERED
        divider = max(0, min(255, int(INTERNAL_RATE / self.rate) - 1))  # samples at least as often as it is read
        values = (
            (BANK, 0x00, 0.0),
            (POWER, RESET, 0.1),
            (POWER, AUTOMATIC_CLOCK, 0.05),
            (POWER_2, 0x00, 0.0),
            (USER_CONTROL, 0x00, 0.0),
            (INTERRUPT_PINS, BYPASS, 0.001),
            (BANK, 0x20, 0.0),
            (GYRO_DIVIDER, divider, 0.0),
            (GYRO_CONFIG, code | GYRO_RANGES.index(self.gyro_range) << 1, 0.0),
            (ACCEL_DIVIDER, 0x00, 0.0),
            (ACCEL_DIVIDER + 1, divider, 0.0),
            (ACCEL_CONFIG, code | ACCEL_RANGES.index(self.accel_range) << 1, 0.0),
            (BANK, 0x00, 0.0),
        )
        writes = [Write(register, bytes((value,)), wait) for register, value, wait in values]
        if self.magnetometer:
            writes += [
                Write(MAG_CONTROL_3, bytes((MAG_RESET,)), 0.01, self.mag_address),
                Write(MAG_CONTROL_2, bytes((MAG_100_HZ,)), 0.001, self.mag_address),
            ]
        return tuple(writes)

    def learn(self, read: Callable[..., Any], write: Callable[..., Any]) -> None:
        """Read back the ranges, which scale every sample, and the id of the magnetometer."""
        configured = {step.register: step.data for step in self.set_up()}
        write(Write(BANK, b"\x20"))
        found = {register: bytes(read(register, 1)) for register in (GYRO_CONFIG, ACCEL_CONFIG)}
        write(Write(BANK, b"\x00"))
        for register, name in ((GYRO_CONFIG, "GYRO_CONFIG_1"), (ACCEL_CONFIG, "ACCEL_CONFIG")):
            if found[register] != configured[register]:
                raise ValueError(
                    f"its register {name} reads 0x{found[register].hex()}, 0x{configured[register].hex()} was written: "
                    "its samples have another range"
                )
        if not self.magnetometer:
            return
        found = read(AK09916_WHO_AM_I, 1, self.mag_address)[0]
        if found != 0x09:
            raise ValueError(
                f"its magnetometer identifies itself as {found:#04x} instead of 0x09 (AK09916). To read the other "
                "sensors only, set magnetometer=False"
            )

    def check(self) -> tuple[int, bytes]:
        return POWER, bytes((AUTOMATIC_CLOCK,))  # a chip that lost its settings is in sleep mode

    def rounds(self) -> tuple[Round, ...]:
        inertial = Round(1.0 / self.rate, (Transfer(0, (Read(BURST, 14),)),))
        if not self.magnetometer:
            return (inertial,)
        return inertial, Round(
            1.0 / self.mag_rate, (Transfer(1, (Read(MAG_STATUS, MAG_BYTES),), address=self.mag_address),)
        )

    def emulator(self, **parameters: Any) -> EmulatedICM20948:
        return EmulatedICM20948.of(self, **parameters)
