"""Inertial measurement units: one family a folder, with its protocol, its block and its emulator."""

from blocks.imus.invensense import ICM20948, MPU9250, EmulatedICM20948, EmulatedMPU9250
from blocks.imus.microstrain import EmulatedMicroStrain, MicroStrain

__all__ = ["EmulatedICM20948", "EmulatedMPU9250", "EmulatedMicroStrain", "ICM20948", "MPU9250", "MicroStrain"]
