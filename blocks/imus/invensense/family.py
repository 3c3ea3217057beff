"""InvenSense IMUs on I2C, with the magnetometers in their cases, as a device family."""

from blocks.imus.invensense.emulator import EmulatedMPU9250
from blocks.imus.invensense.icm20948 import ICM20948
from blocks.imus.invensense.mpu9250 import MPU9250
from graph.family import Benchmark, Chip, Family

ADDRESSES, MAGNETOMETERS = (0x68, 0x69), (0x0C,)
WITHOUT_BLOCK = {0x68: "MPU-6050", 0x70: "MPU-6500", 0x47: "ICM-42688-P"}


class InvenSenseFamily(Family):
    """IMUs by InvenSense on I2C: MPU-9250, MPU-9255 and ICM-20948."""

    name = "InvenSense"
    chips = (
        Chip(ADDRESSES, (0x75, {0x71: "MPU-9250", 0x73: "MPU-9255"}, 0xFF), MPU9250),
        Chip(ADDRESSES, (0x75, WITHOUT_BLOCK, 0xFF)),
        Chip(ADDRESSES, (0x00, {0xEA: "ICM-20948"}, 0xFF), ICM20948),
        Chip(MAGNETOMETERS, (0x00, {0x48: "AK8963"}, 0xFF)),
        Chip(MAGNETOMETERS, (0x01, {0x09: "AK09916"}, 0xFF)),
    )
    benchmark = Benchmark(MPU9250, EmulatedMPU9250)


FAMILY = InvenSenseFamily()
