"""CubeMars AK: quasi-direct-drive actuators with a driver board on CAN."""

from blocks.actuators.cubemars.emulator import EmulatedCubeMars
from blocks.actuators.cubemars.mit import CubeMars

__all__ = ["CubeMars", "EmulatedCubeMars"]
