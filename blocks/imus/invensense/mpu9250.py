"""MPU-9250, MPU-9255 and their magnetometer AK8963 on I2C. (RM-MPU-9250A-00 1.6, AK8963 MS1356-E-02.)"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from blocks.i2c import Identity, Read, Round, Transfer, Write
from blocks.imus.invensense.emulator import EmulatedMPU9250
from blocks.imus.invensense.ports import (
    ACCEL_RANGES,
    AK8963_ADJUSTMENT,
    AK8963_SCALE,
    AK8963_WHO_AM_I,
    GYRO_RANGES,
    UNADJUSTED,
    Bypass,
    InvenSense,
)
from cext.kernels.devices.invensense import chips as kernels
from graph import Param

SAMPLE_RATE_DIVIDER, CONFIG, INTERRUPT_PINS, BURST, USER_CONTROL, POWER, WHO_AM_I = (
    0x19,
    0x1A,
    0x37,
    0x3B,
    0x6A,
    0x6B,
    0x75,
)
RESET, AUTOMATIC_CLOCK, BYPASS = 0x80, 0x01, 0x02
# bit of USER_CONTROL; control of the internal bus; address, register and control of the chip read
MASTER, MASTER_CONTROL, SLAVE = 0x20, 0x24, 0x25
KHZ_400, READS, ENABLED = 0x0D, 0x80, 0x80
# Hz of the gyroscope, code of both filters; the accelerometer's are near them
LOW_PASSES = {184: 1, 92: 2, 41: 3, 20: 4, 10: 5, 5: 6}
INTERNAL_RATE = 1000.0  # Hz, with one of these filters

MAG_STATUS, MAG_CONTROL, MAG_CONTROL_2 = 0x02, 0x0A, 0x0B
MAG_POWER_DOWN, MAG_FUSES, MAG_100_HZ_16_BITS, MAG_RESET = 0x00, 0x0F, 0x16, 0x01
MAG_BYTES = 8  # ST1, three axes, ST2


class MPU9250(InvenSense):
    """MPU-9250 or MPU-9255 on I2C: accelerometer, gyroscope and the magnetometer AK8963.

    mag = raw · 4912/32760 · ((ASA − 128)/256 + 1) µT with the factory adjustment ASA, in the axes of the accelerometer.
    (RM-MPU-9250A-00 1.6, AK8963 MS1356-E-02) The magnetometers of two IMUs on one bus segment, 0x68 and 0x69, have the
    same address: with `bypass=False` each IMU reads its own.
    """

    low_pass = Param(
        41,
        "Hz",
        "cut-off of the low-pass of gyroscope and accelerometer",
        choices=tuple(LOW_PASSES),
        fixed=True,
        kernel=False,
    )

    bypass = Bypass.bypass

    kind = "MPU-9250"
    decode = kernels.mpu_decode
    mag_scale = AK8963_SCALE
    adjustment = UNADJUSTED  # of the magnetometer, once it has been read

    def release(self) -> tuple[Write, ...]:
        """Disconnect the magnetometer from the bus, so that another with the same address can be configured."""
        return (Write(INTERRUPT_PINS, b"\x00"),)

    def settings(self) -> bytes:
        """Registers from SAMPLE_RATE_DIVIDER on: divider, low-pass, gyroscope, accelerometer, its low-pass."""
        code = LOW_PASSES[self.low_pass]
        divider = max(0, min(255, int(INTERNAL_RATE / self.rate) - 1))  # samples at least as often as it is read
        return bytes(
            (divider, code, GYRO_RANGES.index(self.gyro_range) << 3, ACCEL_RANGES.index(self.accel_range) << 3, code)
        )

    def identities(self) -> tuple[Identity, ...]:
        return (Identity(WHO_AM_I, {0x71: "MPU-9250", 0x73: "MPU-9255"}),)

    def set_up(self) -> tuple[Write, ...]:
        writes = [
            Write(POWER, bytes((RESET,)), wait=0.1),
            Write(POWER, bytes((AUTOMATIC_CLOCK,)), wait=0.05),
            *(Write(SAMPLE_RATE_DIVIDER + place, bytes((value,))) for place, value in enumerate(self.settings())),
            Write(USER_CONTROL, b"\x00"),
            Write(INTERRUPT_PINS, bytes((BYPASS,)), wait=0.001),
        ]
        if self.magnetometer:
            writes += [
                self.mag_write(MAG_CONTROL_2, MAG_RESET, 0.01),
                self.mag_write(MAG_CONTROL, MAG_POWER_DOWN, 0.001),
                self.mag_write(MAG_CONTROL, MAG_100_HZ_16_BITS, 0.001),
                *self.asks_by_itself(),
            ]
        return tuple(writes)

    def asks_by_itself(self) -> tuple[Write, ...]:
        """Return the writes after which the chip reads the magnetometer at each sample, behind its own data."""
        if self.bypass:
            return ()
        values = (
            (INTERRUPT_PINS, 0x00),
            (USER_CONTROL, MASTER),
            (MASTER_CONTROL, KHZ_400),
            (SLAVE, READS | self.mag_address),
            (SLAVE + 1, MAG_STATUS),
            (SLAVE + 2, ENABLED | MAG_BYTES),
        )
        return tuple(Write(register, bytes((value,))) for register, value in values)

    def mag_write(self, register: int, value: int, wait: float) -> Write:
        """Return a write to a register of the magnetometer. wait : s afterwards"""
        return Write(register, bytes((value,)), wait, self.mag_address)

    def learn(self, read: Callable[..., Any], write: Callable[..., Any]) -> None:
        """Read the factory adjustment from the fuses, which requires a separate mode."""
        if not self.magnetometer:
            return
        if not self.bypass:
            write(Write(USER_CONTROL, b"\x00"))
            write(Write(INTERRUPT_PINS, bytes((BYPASS,)), 0.001))
        found = read(AK8963_WHO_AM_I, 1, self.mag_address)[0]
        if found != 0x48:
            raise ValueError(
                f"its magnetometer identifies itself as {found:#04x} instead of 0x48 (AK8963). To read the other "
                "sensors only, set magnetometer=False"
            )
        write(self.mag_write(MAG_CONTROL, MAG_POWER_DOWN, 0.001))
        write(self.mag_write(MAG_CONTROL, MAG_FUSES, 0.001))
        self.adjustment = bytes(read(AK8963_ADJUSTMENT, 3, self.mag_address))
        write(self.mag_write(MAG_CONTROL, MAG_POWER_DOWN, 0.001))
        for one in (self.mag_write(MAG_CONTROL, MAG_100_HZ_16_BITS, 0.001), *self.asks_by_itself()):
            write(one)

    def check(self) -> tuple[int, bytes]:
        return SAMPLE_RATE_DIVIDER, self.settings()

    def rounds(self) -> tuple[Round, ...]:
        inertial = Round(1.0 / self.rate, (Transfer(0, (Read(BURST, 14),)),))
        if not self.magnetometer:
            return (inertial,)
        if not self.bypass:
            return (Round(inertial.period, (Transfer(2, (Read(BURST, 14 + MAG_BYTES),), appended=self.adjustment),)),)
        return inertial, Round(
            1.0 / self.mag_rate,
            (Transfer(1, (Read(MAG_STATUS, MAG_BYTES),), appended=self.adjustment, address=self.mag_address),),
        )

    def emulator(self, **parameters: Any) -> EmulatedMPU9250:
        return EmulatedMPU9250.of(self, **parameters)
