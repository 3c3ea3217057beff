"""Emulated Damiao drive in MIT mode."""

from __future__ import annotations

from blocks.actuators.emulated import Emulated
from graph import Device, Memory, Param
from tickwork_damiao import kernels, models, protocol

REGISTERS = 96


class EmulatedDamiao(Emulated, Device):
    """Emulated Damiao drive: it exchanges the bytes of MIT mode and of the registers.

    `fault` is a status from 8 on; it disables the drive and stays until it is cleared, as does the time-out of its
    register TIMEOUT. Registers are lost at power-off unless they are stored. MST_ID, ESC_ID and the ranges take effect
    when they are written.
    """

    can_id = Param(1, "1", "CAN id of the drive", min=1, max=15, fixed=True)
    master_id = Param(17, "1", "CAN id of its replies", min=0, max=0x7FE, fixed=True, kernel=False)

    registers = Memory((0.0,) * REGISTERS, "values of the registers")
    stored = Memory((0.0,) * REGISTERS, "values of the registers after power-on")
    latched = Memory(0.0, "status of the fault until it is cleared")

    examples = ({"model": "DM-J4310"},)
    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self) -> None:
        spec = self.find(self.model)
        if self.peak is None:
            self.peak = (spec.peak or spec.wire_torque) * self.gear_ratio
        super().configure()
        ratio = self.gear_ratio
        values = {
            protocol.MST_ID: self.master_id,
            protocol.ESC_ID: self.can_id,
            protocol.CTRL_MODE: protocol.MIT,
            protocol.PMAX: self.wire[0] * ratio,
            protocol.VMAX: self.wire[1] * ratio,
            protocol.TMAX: self.wire[4] / ratio,
            protocol.REGISTERS["Gr"]: spec.gear,
        }
        self.registers = self.stored = tuple(float(values.get(index, 0.0)) for index in range(REGISTERS))

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, False)]
