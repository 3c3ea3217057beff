"""Sensors other than IMUs: voltages, load cells, contacts, insoles, microcontrollers, streams of a laboratory."""

from blocks.sensors.ads1115 import ADS1115, EmulatedADS1115
from blocks.sensors.forces import FSR, EmulatedFSR, EmulatedLoadCell, LoadCell
from blocks.sensors.insole import EmulatedInsole, FootContact, Insole
from blocks.sensors.lsl import LslInlet
from blocks.sensors.microcontroller import EmulatedMicrocontroller, Microcontroller
from blocks.sensors.nau7802 import NAU7802, EmulatedNAU7802

__all__ = [
    "ADS1115",
    "EmulatedADS1115",
    "EmulatedFSR",
    "EmulatedInsole",
    "EmulatedLoadCell",
    "EmulatedMicrocontroller",
    "EmulatedNAU7802",
    "FSR",
    "FootContact",
    "Insole",
    "LoadCell",
    "LslInlet",
    "Microcontroller",
    "NAU7802",
]
