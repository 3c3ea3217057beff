"""Actuators: one family a folder, with a table of its models, its protocol and its emulator."""

from blocks.actuators.cubemars import CubeMars, EmulatedCubeMars
from blocks.actuators.robstride import EmulatedRobStride, RobStride

__all__ = ["CubeMars", "EmulatedCubeMars", "EmulatedRobStride", "RobStride"]
