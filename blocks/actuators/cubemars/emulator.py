"""Emulated CubeMars AK drive in MIT mode, with the same frames."""

from __future__ import annotations

from typing import Any

from blocks.actuators.cubemars import models
from blocks.actuators.cubemars.frames import REPLIES
from blocks.actuators.emulated import Emulated
from cext.kernels.devices.cubemars import mit as kernels
from graph import Device, Param


class EmulatedCubeMars(Emulated, Device):
    """Emulated drive in MIT mode: outputs torque and replies to each command with its state.

    Torque is the drive's law of the last command, up to the peak torque, and zero until it is enabled, after it
    is disabled and while it has a fault. `EmulatedCubeMars.of(robot["left/knee"])` emulates the drive of a robot's
    block.
    """

    reply = Param(8, "1", "bytes of a reply: 7 and 6 contain no temperature and no error", choices=REPLIES, fixed=True)

    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    @classmethod
    def of(cls, actuator: Any, **parameters: Any) -> EmulatedCubeMars:
        return super().of(actuator, **{"reply": actuator.reply} | parameters)

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, False)]
