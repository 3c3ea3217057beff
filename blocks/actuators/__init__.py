"""Actuators: one family a folder, with a table of its models, its protocol and its emulator."""

from blocks.actuators.cubemars import CubeMars, EmulatedCubeMars

__all__ = ["CubeMars", "EmulatedCubeMars"]
