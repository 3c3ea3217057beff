"""CubeMars AK: quasi-direct-drive actuators with a driver board on CAN."""

from blocks.actuators.cubemars.emulator import EmulatedCubeMars
from blocks.actuators.cubemars.emulator_v3 import EmulatedCubeMarsServo, EmulatedCubeMarsV3
from blocks.actuators.cubemars.mit import CubeMars
from blocks.actuators.cubemars.servo import CubeMarsServo
from blocks.actuators.cubemars.v3 import CubeMarsV3

__all__ = ["CubeMars", "CubeMarsServo", "CubeMarsV3", "EmulatedCubeMars", "EmulatedCubeMarsServo", "EmulatedCubeMarsV3"]
