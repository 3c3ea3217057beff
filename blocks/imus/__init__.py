"""Inertial measurement units."""

from blocks.imus.invensense import ICM20948, MPU9250, EmulatedICM20948, EmulatedMPU9250

__all__ = ["EmulatedICM20948", "EmulatedMPU9250", "ICM20948", "MPU9250"]
