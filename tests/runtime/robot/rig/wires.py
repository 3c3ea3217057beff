"""Chips in memory behind the methods of smbus2.SMBus, for what is set up on a machine without I2C. The real one is in
tests/hardware.
"""

from cext.lines.i2c_memory import MemoryI2c
from runtime.robot.rig.chips import AdapterWires as Wires
from runtime.robot.rig.chips import Chips
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.i2c import I2cInterface

BUS = RigBus("imus", "i2c", "/dev/i2c-1")
ADJUSTMENT = bytes((176, 100, 166))


def add_mpu(wires, address=0x68, place=0, name=0x71):
    """A chip with the magnetometer beside it. Returns their numbers."""
    imu, mag = wires.add(address, place), wires.add(0x0C, place)
    wires.write(imu, 0x75, bytes((name,)))
    wires.write(mag, 0x00, b"\x48")
    wires.write(mag, 0x10, ADJUSTMENT)
    return imu, mag


def opened(wires, *devices):
    return I2cInterface(BUS, devices, (Chips(Wires(wires)), wires))


__all__ = ["ADJUSTMENT", "BUS", "MemoryI2c", "Wires", "add_mpu", "opened"]
