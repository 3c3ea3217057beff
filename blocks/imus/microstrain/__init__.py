"""MicroStrain sensors 3DM-GX5, CX5, CV5, CV7, GV7 and related models, with MIP over a serial line."""

from blocks.imus.microstrain.block import MicroStrain
from blocks.imus.microstrain.emulator import EmulatedMicroStrain

__all__ = ["EmulatedMicroStrain", "MicroStrain"]
