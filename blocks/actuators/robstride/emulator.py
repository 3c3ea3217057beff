"""A RobStride drive that is not there: it speaks the same bytes, for a plant."""

from blocks.actuators.emulated import Emulated
from blocks.actuators.robstride import frames, models
from cext.kernels import robstride_drive as kernels
from graph import Device, Memory, Param

LOC_KP, SPD_KP, VBUS = 0x701E, 0x701F, 0x701C
POSITION_GAIN = 30.0            # 1/s, as the manual prints it
VELOCITY_GAIN = 5.0             # N·m·s/rad, ours: the vendor's is tuned to its motor


class EmulatedRobStride(Emulated, Device):
    """A RobStride drive or a CyberGear on the in-memory bus: hears the private protocol in every mode, gives torque, and answers.

    Torque is the law of its run mode, up to its limits and the peak torque, and zero until it is enabled, after it is stopped, while it has
    a fault and when it has heard nothing for its canTimeout. `fault`: its six bits of the feedback, which stay until they are cleared,
    and from bit 8 on those of a fault report. Its parameters can be read and written. `EmulatedRobStride.of(robot["left/knee"])` plays
    the drive that a robot's block commands.
    """

    can_id = Param(127, "1", "its id", min=1, max=127, fixed=True)
    trip_temperature = Param(
        None, "°C", "temperature at which it protects itself with a fault; the model's by default", dtype=float, fixed=True)

    registers = Memory((0.0,) * 64, "values of the parameters 0x7000 to 0x703F")
    defaults = Memory((0.0,) * 64, "the same after power on")
    memory_of_drive = Memory((0.0,) * 6, "host, faults latched, faults reported, whether it reports, when next, torque constant")

    find = staticmethod(models.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self):
        super().configure()
        found = self.found
        if self.trip_temperature is None:
            self.trip_temperature = found.too_hot
        values = {
            frames.LIMIT_TORQUE: found.peak, frames.LIMIT_SPD: 2.0, frames.LIMIT_CUR: found.peak_current, VBUS: 48.0, LOC_KP: POSITION_GAIN,
            SPD_KP: VELOCITY_GAIN / found.torque_constant / self.gear_ratio**2,
        }
        if not found.is_cybergear:                      # which knows one limit of speed, LIMIT_SPD
            values |= {frames.VEL_MAX: 10.0, frames.ACC_SET: 10.0, frames.ACC_RAD: 20.0}
        self.registers = self.defaults = tuple(values.get(0x7000 + place, 0.0) for place in range(64))
        self.memory_of_drive = (0xFD, 0.0, 0.0, 0.0, 0.0, found.torque_constant)

    def addresses(self):
        return [(self.can_id, True)]
