"""A CubeMars AK drive that is not there: it speaks the same bytes, for a plant."""

from blocks.actuators.cubemars import models
from cext.kernels import cubemars as kernels
from graph import Device, Input, Interval, Memory, Output, Param


class EmulatedCubeMars(Device):
    """A drive in MIT mode on the in-memory bus: hears commands, gives torque, and answers each frame with its state.

    Torque is the drive's law of the last command heard, up to the peak torque, and zero until it is enabled, after it is disabled and
    while it has a fault. `EmulatedCubeMars.of(robot["left/knee"])` plays the drive that a robot's block commands.
    """

    model = Param("", "1", "as for CubeMars", required=True, dtype=str)
    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    can_id = Param(1, "1", "its id", min=1, max=255, fixed=True)
    invert = Param(False, "1", "whether the joint turns against the motor", fixed=True)
    offset = Param(
        0.0, "rad", "motor position where the joint is at zero, the way the joint turns", min=-models.POSITION, max=models.POSITION,
        fixed=True)
    peak = Param(None, "N·m", "torque it gives at most; the model's peak by default", above=0.0, dtype=float, fixed=True)

    position = Input("rad", "of the joint")
    velocity = Input("rad/s", "of the joint")
    temperature = Input("°C", "of the drive", default=30.0)
    fault = Input("1", "error code it reports", default=0, dtype=int)
    torque = Output("N·m", "at the joint")
    enabled = Output("1", "whether it has been enabled", dtype=bool)
    wire = Memory(0.0, "half ranges on the wire: position, velocity, stiffness, damping, torque")
    command = Memory((0.0,) * 5, "position, velocity, stiffness, damping, torque last heard")
    state = Memory((0.0,) * 3, "enabled, replies due, zero of the encoder")

    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode
    feedthrough = ("position", "velocity", "temperature", "fault")

    @classmethod
    def of(cls, actuator, **parameters):
        """The emulator of one CubeMars block of a robot."""
        return cls(actuator.model, bus=actuator.bus, can_id=actuator.can_id, invert=actuator.invert, offset=actuator.offset, **parameters)

    def configure(self):
        found = models.find(self.model)
        self.wire = (models.POSITION, found.wire_velocity, models.STIFFNESS, models.DAMPING, found.wire_torque)
        if self.peak is None:
            self.peak = found.peak

    def output_range(self, **inputs):
        return {"torque": Interval(-self.peak, self.peak), "enabled": Interval(0.0, 1.0)}

    def addresses(self):
        return [(self.can_id, False)]
