"""The laboratory's own drive: a device family for Tickwork."""

from gaitlab.drive.block import GaitDrive
from gaitlab.drive.emulator import EmulatedGaitDrive

__all__ = ["EmulatedGaitDrive", "GaitDrive"]
