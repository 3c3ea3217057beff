"""Sensors other than IMUs: encoders, voltages, load cells, contacts, insoles, microcontrollers, streams of a lab."""

from blocks.sensors.ads1115 import ADS1115, EmulatedADS1115
from blocks.sensors.as504x import AS5047, AS5048A, EmulatedAS5047, EmulatedAS5048A
from blocks.sensors.as5048b import AS5048B, EmulatedAS5048B
from blocks.sensors.as5600 import AS5600, EmulatedAS5600
from blocks.sensors.bno085 import BNO085RVC, EmulatedBNO085RVC
from blocks.sensors.forces import FSR, EmulatedFSR, EmulatedLoadCell, LoadCell
from blocks.sensors.insole import EmulatedInsole, FootContact, Insole
from blocks.sensors.lsl import LslInlet
from blocks.sensors.microcontroller import EmulatedMicrocontroller, Microcontroller
from blocks.sensors.nau7802 import NAU7802, EmulatedNAU7802
from blocks.sensors.ros2 import Ros2Subscription

__all__ = [
    "ADS1115",
    "AS5047",
    "AS5048A",
    "AS5048B",
    "AS5600",
    "BNO085RVC",
    "EmulatedADS1115",
    "EmulatedAS5047",
    "EmulatedAS5048A",
    "EmulatedAS5048B",
    "EmulatedAS5600",
    "EmulatedBNO085RVC",
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
    "Ros2Subscription",
]
