"""Inertial sensors: one family a folder, with its tables, its protocol and its emulator."""

from blocks.imus.microstrain import EmulatedMicroStrain, MicroStrain

__all__ = ["EmulatedMicroStrain", "MicroStrain"]
