"""The laboratory's drive, emulated: it exchanges the same bytes, for a plant."""

from gaitlab.drive import kernels, models, protocol

from graph import Device, Input, Interval, Memory, Output, Param


class EmulatedGaitDrive(Device):
    """A drive on the in-memory bus: it takes commands, gives torque, and answers with its state.

    `EmulatedGaitDrive.of(robot["knee"])` plays the drive that a robot's block commands.
    """

    model = Param("GD-10", "1", "name of the model", dtype=str)
    bus = Param("can", "1", "logical name of the CAN bus", dtype=str)
    can_id = Param(1, "1", "its id", min=1, max=127, fixed=True)
    gear_ratio = Param(1.0, "1", "gear behind the drive: motor angle over joint angle", above=0.0, fixed=True)

    position = Input("rad", "angle of the joint")
    velocity = Input("rad/s", "velocity of the joint")
    fault = Input("1", "error code that it reports", default=0, dtype=int)
    torque = Output("N·m", "torque at the joint")
    state = Memory((0.0,) * 5, "CAN id, 1 if enabled, torque command, zero of the encoder, pending replies")

    feedthrough = ("fault",)
    kernel = kernels.drive
    decode = kernels.emulated_decode
    encode = kernels.emulated_encode

    @classmethod
    def of(cls, drive, **parameters):
        """Return the emulator of one block of a robot."""
        return cls(**{name: getattr(drive, name) for name in ("model", "bus", "can_id", "gear_ratio")} | parameters)

    def addresses(self):
        return [(protocol.COMMAND + self.can_id, False)]

    def output_range(self, **inputs):
        peak = models.find(self.model).wire_torque * self.gear_ratio
        return {"torque": Interval(-peak, peak)}
