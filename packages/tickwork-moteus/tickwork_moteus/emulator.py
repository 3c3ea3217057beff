"""Emulated moteus controller."""

from __future__ import annotations

from blocks.actuators.emulated import Emulated
from graph import Device, Memory, Param
from tickwork_moteus import kernels, models


class EmulatedMoteus(Emulated, Device):
    """Emulated moteus controller in position mode, with the registers of state and command in every resolution.

    `fault` is a code from 32 on; it stops the drive, as does its time-out, until a stop clears it. In the time-out the
    drive damps the joint with its whole kd and at most 5 N·m. It answers the first eight bytes of reads in a frame.
    """

    can_id = Param(1, "1", "CAN id of the drive", min=1, max=127, fixed=True)
    supply = Param(24.0, "V", "supply voltage that it reports", min=0.0, fixed=True)

    mode = Memory(0.0, "mode: 0 stopped, 1 fault, 10 position, 11 time-out")
    latched = Memory(0.0, "fault until a stop clears it")
    permitted = Memory((0.0,) * 2, "largest torque in N·m at the drive, and time-out in s, of the last command")

    examples = ({"model": "moteus-n1"},)
    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self) -> None:
        if self.peak is None:
            self.peak = self.find(self.model).wire_torque * self.gear_ratio
        super().configure()

    def addresses(self) -> list[tuple[int, bool]]:
        return [(0x8000 | self.can_id, True)]

    def displayed_addresses(self) -> list[int]:
        return [self.can_id]
