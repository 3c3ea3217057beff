"""Emulated CubeMars AK drive: it exchanges the same bytes, for a plant."""

from blocks.actuators.cubemars import models
from blocks.actuators.cubemars.frames import REPLIES
from blocks.actuators.emulated import Emulated
from cext.kernels.devices.cubemars import mit as kernels
from graph import Device, Param


class EmulatedCubeMars(Emulated, Device):
    """A drive in MIT mode on the in-memory bus: it takes commands, gives torque, and answers each frame with its state.

    Torque is the drive's law of the last command, up to the peak torque, and zero until it is enabled, after it
    is disabled and while it has a fault. `EmulatedCubeMars.of(robot["left/knee"])` plays the drive that a robot's block
    commands.
    """

    reply = Param(8, "1", "bytes of its replies: 7 and 6 have no temperature and no error", choices=REPLIES, fixed=True)

    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    @classmethod
    def of(cls, actuator, **parameters):
        return super().of(actuator, **{"reply": actuator.reply} | parameters)

    def addresses(self):
        return [(self.can_id, False)]
