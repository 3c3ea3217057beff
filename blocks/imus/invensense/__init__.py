"""IMUs of InvenSense on I2C: accelerometer and gyroscope, with a magnetometer of AKM in the same case."""

from blocks.imus.invensense.emulator import EmulatedICM20948, EmulatedMPU9250
from blocks.imus.invensense.icm20948 import ICM20948
from blocks.imus.invensense.mpu9250 import MPU9250

__all__ = ["EmulatedICM20948", "EmulatedMPU9250", "ICM20948", "MPU9250"]
