"""Emulated CubeMars AK drive in MIT mode, with the same frames."""

from __future__ import annotations

from typing import Any

from blocks.actuators.cubemars import models
from blocks.actuators.cubemars.frames import ERRORS, MASK, REPLIES
from blocks.actuators.emulated import Emulated
from cext.kernels.devices.cubemars import mit as kernels
from graph import Device, Memory, Param


class EmulatedCubeMars(Emulated, Device):
    """Emulated drive in MIT mode: outputs torque and replies to each command with its state.

    Torque is the drive's law of the last command, up to the peak torque, and zero until it is enabled, after it
    is disabled and while it has a fault. `EmulatedCubeMars.of(robot["left/knee"])` emulates the drive of a robot's
    block.
    """

    reply = Param(8, "1", "bytes of a reply: 7 and 6 contain no temperature and no error", choices=REPLIES, fixed=True)

    errors = Param(
        "",
        "1",
        "meaning of its error byte: code, or mask of 80 °C (2) and 120 °C (4); the model's by default",
        choices=("", *ERRORS),
        fixed=True,
        kernel=False,
    )
    command_timeout = Param(
        0.0, "s", "time without a command after which its command is zero; it stays enabled", min=0.0, fixed=True
    )
    zero_when_enabled = Param(
        True, "1", "whether it sets its zero while it is enabled; original Katz firmware does not", fixed=True
    )
    reply_first = Param(
        False, "1", "whether a reply has the state before its command, as that of original Katz firmware", fixed=True
    )
    masks = Memory(0.0, "1 if its error byte is a mask")
    warm = Memory(0.0, "bits of the mask that its temperature has set")

    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self) -> None:
        super().configure()
        self.masks = float((self.errors or self.spec.errors) == MASK)

    @classmethod
    def of(cls, actuator: Any, **parameters: Any) -> EmulatedCubeMars:
        return super().of(actuator, **{"reply": actuator.reply, "errors": actuator.errors} | parameters)

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, False)]
