"""Inertial sensors: one family a folder, with its tables, its protocol and its emulator."""

from blocks.imus.microstrain import EmulatedMicroStrain, MicroStrain
from blocks.imus.openimu import EmulatedOpenImu, OpenImu

__all__ = ["EmulatedMicroStrain", "EmulatedOpenImu", "MicroStrain", "OpenImu"]
