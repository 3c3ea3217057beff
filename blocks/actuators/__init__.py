"""Actuators: one family a folder, with a table of its models, its protocol and its emulator."""

from blocks.actuators.cubemars import CubeMars, EmulatedCubeMars
from blocks.actuators.robstride import EmulatedRobStride, EmulatedRobStrideMIT, RobStride, RobStrideMIT

__all__ = ["CubeMars", "EmulatedCubeMars", "EmulatedRobStride", "EmulatedRobStrideMIT", "RobStride", "RobStrideMIT"]
