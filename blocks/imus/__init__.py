"""Inertial measurement units: one family a folder, with its protocol and its emulator."""

from blocks.imus.openimu import EmulatedOpenImu, OpenImu

__all__ = ["EmulatedOpenImu", "OpenImu"]
