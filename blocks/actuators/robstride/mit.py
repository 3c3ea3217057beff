"""RobStride actuators that have been set to the vendor's MIT protocol, on standard frames."""

from blocks.actuators.emulated import Emulated
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import DISABLE, ENABLE, StopInMitMode
from blocks.actuators.robstride import models
from blocks.actuators.robstride.models import TEMPERATURE
from cext.kernels import robstride_mit as kernels
from graph import Actuator, Device, Interval, Param

CLEAR_FAULT = b"\xff\xff\xff\xff\xff\xff\xff\xfb"
OPERATION = b"\xff\xff\xff\xff\xff\xff\x00\xfc"     # of the modes: MIT 0, position 1, velocity 2


def find(name):
    """The model of that name. ValueError for the CyberGear, which has no MIT protocol."""
    found = models.find(name)
    if found.is_cybergear:
        raise ValueError("the CyberGear has no MIT protocol: use RobStride")
    return found


class RobStrideMIT(StopInMitMode, Joint, Actuator):
    """A RobStride actuator set to its MIT protocol: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (RobStride user manuals of 2026-04-28, section 6.) As RobStride in operation control, with three costs: its replies tell no fault,
    nothing tells whether the drive is enabled, and its time-out cannot be set from here. `fault` stays 0: watch `temperature`.
    """

    can_id = Param(127, "1", "id set in the drive", min=1, max=127, fixed=True)
    host_id = Param(0xFD, "1", "id that the drive answers from", min=0, max=255, fixed=True)

    hardware = (*Joint.hardware, "host_id")
    find = staticmethod(find)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self):
        super().configure()
        if self.can_id == self.host_id:
            raise ValueError(f"can_id and host_id are both {self.can_id}: the drive and its host need ids of their own")

    def output_range(self, **commands):
        return super().output_range() | {"temperature": TEMPERATURE, "fault": Interval.point(0.0)}

    def addresses(self):
        return [(self.can_id, False)]

    def hears(self):
        return [(self.host_id, 0x7FF, False), (self.can_id, 0x7FF, False)]      # its own, and what anybody commands

    def replies(self):
        return [(self.host_id, 0x7FF, False, bytes([self.can_id]))]

    def enable_frames(self):
        return [(self.can_id, False, DISABLE), (self.can_id, False, OPERATION), (self.can_id, False, ENABLE)]

    def emulator(self, **parameters):
        return EmulatedRobStrideMIT.of(self, host_id=self.host_id, **parameters)


class EmulatedRobStrideMIT(Emulated, Device):
    """A RobStride drive set to its MIT protocol, on the in-memory bus. A fault disables it, and its answers do not say why."""

    can_id = Param(127, "1", "its id", min=1, max=127, fixed=True)
    host_id = Param(0xFD, "1", "id that it answers from", min=0, max=255, fixed=True)

    find = staticmethod(find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def addresses(self):
        return [(self.can_id, False)]
