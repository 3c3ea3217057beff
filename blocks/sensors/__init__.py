"""Sensors that are no IMUs: what comes over a line of bytes."""

from blocks.sensors.insole import EmulatedInsole, FootContact, Insole
from blocks.sensors.microcontroller import EmulatedMicrocontroller, Microcontroller

__all__ = ["EmulatedInsole", "EmulatedMicrocontroller", "FootContact", "Insole", "Microcontroller"]
