"""RobStride actuators and the CyberGear: quasi-direct drives with a driver board on CAN."""

from blocks.actuators.robstride.emulator import EmulatedRobStride
from blocks.actuators.robstride.mit import EmulatedRobStrideMIT, RobStrideMIT
from blocks.actuators.robstride.private import RobStride

__all__ = ["EmulatedRobStride", "EmulatedRobStrideMIT", "RobStride", "RobStrideMIT"]
