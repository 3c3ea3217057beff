"""Sensors that are no IMUs: what comes over a line of bytes."""

from blocks.sensors.microcontroller import EmulatedMicrocontroller, Microcontroller

__all__ = ["EmulatedMicrocontroller", "Microcontroller"]
