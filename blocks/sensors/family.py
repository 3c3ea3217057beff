"""Analogue-to-digital converters on I2C, as a device family."""

from blocks.sensors.ads1115 import ADS1115
from blocks.sensors.nau7802 import NAU7802
from graph.family import Chip, Family


class ConverterFamily(Family):
    """Analogue-to-digital converters on I2C: NAU7802, ADS1115 and ADS1015."""

    name = "analogue-to-digital converters"
    chips = (
        Chip((0x2A,), (0x1F, {0x0F: "NAU7802"}, 0x0F), NAU7802),
        Chip((0x48, 0x49, 0x4A, 0x4B), block=ADS1115, name="ADS1115 or ADS1015"),
    )


FAMILY = ConverterFamily()
