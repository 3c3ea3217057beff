"""Actuators: one family a folder, with a table of its models, its protocol and its emulator."""

from blocks.actuators.cubemars import CubeMars, CubeMarsV3, EmulatedCubeMars, EmulatedCubeMarsV3
from blocks.actuators.robstride import EmulatedRobStride, EmulatedRobStrideMIT, RobStride, RobStrideMIT

__all__ = [
    "CubeMars", "CubeMarsV3", "EmulatedCubeMars", "EmulatedCubeMarsV3", "EmulatedRobStride", "EmulatedRobStrideMIT", "RobStride", "RobStrideMIT",
]
