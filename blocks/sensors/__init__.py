"""Sensors that are no IMUs: voltages, load cells, contacts."""

from blocks.sensors.ads1115 import ADS1115, EmulatedADS1115
from blocks.sensors.forces import FSR, LoadCell
from blocks.sensors.nau7802 import NAU7802, EmulatedNAU7802

__all__ = ["ADS1115", "EmulatedADS1115", "EmulatedNAU7802", "FSR", "LoadCell", "NAU7802"]
