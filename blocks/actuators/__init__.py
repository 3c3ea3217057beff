"""Actuators: one family a folder, with a table of its models, its protocol and its emulator."""

from blocks.actuators.by_name import Actuator, actuators
from blocks.actuators.cubemars import (
    CubeMars,
    CubeMarsServo,
    CubeMarsV3,
    EmulatedCubeMars,
    EmulatedCubeMarsServo,
    EmulatedCubeMarsV3,
)
from blocks.actuators.robstride import EmulatedRobStride, EmulatedRobStrideMIT, RobStride, RobStrideMIT

__all__ = [
    "Actuator",
    "CubeMars",
    "CubeMarsServo",
    "CubeMarsV3",
    "EmulatedCubeMars",
    "EmulatedCubeMarsServo",
    "EmulatedCubeMarsV3",
    "EmulatedRobStride",
    "EmulatedRobStrideMIT",
    "RobStride",
    "RobStrideMIT",
    "actuators",
]
