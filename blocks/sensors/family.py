"""Converters and encoders on I2C, as a device family."""

from blocks.sensors.ads1115 import ADS1115
from blocks.sensors.as5048b import AS5048B
from blocks.sensors.as5600 import AS5600
from blocks.sensors.nau7802 import NAU7802
from graph.family import Chip, Family


class ConverterFamily(Family):
    """Sensors on I2C that are not inertial: NAU7802, ADS1115 and ADS1015, AS5600 and AS5048B."""

    name = "converters and encoders"
    chips = (
        Chip((0x2A,), (0x1F, {0x0F: "NAU7802"}, 0x0F), NAU7802),
        Chip((0x48, 0x49, 0x4A, 0x4B), block=ADS1115, name="ADS1115 or ADS1015"),
        Chip((0x36,), block=AS5600, name="AS5600"),
        Chip((0x40, 0x41, 0x42, 0x43), block=AS5048B, name="AS5048B"),
    )


FAMILY = ConverterFamily()
