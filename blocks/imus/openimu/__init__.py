"""Aceinna's OpenIMU 300RI and 335RI, over CAN by SAE J1939."""

from blocks.imus.openimu.emulator import EmulatedOpenImu
from blocks.imus.openimu.imu import OpenImu

__all__ = ["EmulatedOpenImu", "OpenImu"]
