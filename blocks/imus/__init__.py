"""Inertial sensors: one family a folder, with its tables, its protocol and its emulator."""

from blocks.imus.invensense import ICM20948, MPU9250, EmulatedICM20948, EmulatedMPU9250
from blocks.imus.microstrain import EmulatedMicroStrain, MicroStrain
from blocks.imus.openimu import EmulatedOpenImu, OpenImu

__all__ = [
    "EmulatedICM20948",
    "EmulatedMPU9250",
    "EmulatedMicroStrain",
    "EmulatedOpenImu",
    "ICM20948",
    "MPU9250",
    "MicroStrain",
    "OpenImu",
]
