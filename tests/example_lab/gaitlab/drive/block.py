"""The laboratory's drive as a block: torque is commanded, and its state comes with every reply."""

from gaitlab.drive import kernels, models, protocol
from gaitlab.drive.emulator import EmulatedGaitDrive

from graph import Actuator, Input, Interval, Output, Param, TorqueBound


class GaitDrive(Actuator):
    """The laboratory's drive: it gives `torque_command`, within `limit`, once it is enabled."""

    model = Param("", "1", "GD-10 or GD-30", required=True, dtype=str)
    bus = Param("can", "1", "logical name of the CAN bus", dtype=str)
    can_id = Param(1, "1", "id set in the drive", min=1, max=127, fixed=True)
    limit = Param(None, "N·m", "largest command at the joint; the rated torque by default", dtype=float, fixed=True)
    gear_ratio = Param(1.0, "1", "gear behind the drive: motor angle over joint angle", above=0.0, fixed=True)
    timeout = Param(
        0.1, "s", "silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True, kernel=False
    )

    torque_command = Input("N·m", "torque at the joint", default=0.0)
    position = Output("rad", "joint angle")
    velocity = Output("rad/s", "joint velocity")
    torque = Output("N·m", "torque at the joint, from the drive's current")
    temperature = Output("°C", "temperature of the drive")
    fault = Output("1", "error code, 0 for none", dtype=int)
    age = Output("s", "time since the newest reply")
    torque_sent = Output("N·m", "torque of the newest frame, after fade-in and rounding")

    examples = ({"model": "GD-10"}, {"model": "GD-30", "limit": 5.0, "gear_ratio": 2.0})
    hardware = ("can_id",)
    sent_outputs = ("torque_sent",)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self):
        self.spec = models.find(self.model)
        self.model = self.spec.name
        rated = self.spec.rated * self.gear_ratio
        self.limit = rated if self.limit is None else self.limit
        if not 0.0 < self.limit <= self.spec.peak * self.gear_ratio:
            raise ValueError(f"limit must be above 0 and at most the peak torque of {self.model}, got {self.limit:g}")

    def command_limits(self):
        return {"torque_command": Interval(-self.limit, self.limit)}

    def rating(self):
        return f"limit of {self.model}"

    def torque_bound(self, commands, period):
        return TorqueBound("proved", self.limit)

    def output_range(self, **commands):
        spec, ratio = self.spec, self.gear_ratio
        position, velocity, torque = 32.768 / ratio, 327.68 / ratio, spec.wire_torque * ratio * 1.01
        return {
            "position": Interval(-position, position),
            "velocity": Interval(-velocity, velocity),
            "torque": Interval(-torque, torque),
            "torque_sent": Interval(-torque, torque),
            "temperature": Interval(-40.0, 215.0),
            "fault": Interval(0.0, 63.0),
            "age": Interval(0.0),
        }

    def addresses(self):
        return [(protocol.COMMAND + self.can_id, False)]

    def acceptance_filters(self):
        return [(protocol.REPLY + self.can_id, 0x7FF, False)]

    def replies(self):
        """Return the replies of a drive that is not enabled."""
        return [(protocol.REPLY + self.can_id, 0x7FF, False, ".[02468ace]")]

    def traffic(self):
        return [(4, False), (8, False)]

    def enable_frames(self):
        return [protocol.frame(protocol.ENABLE, self.can_id)]

    def zero_frames(self):
        return [protocol.frame(protocol.TORQUE, self.can_id)]

    def disable_frames(self):
        return [protocol.frame(protocol.DISABLE, self.can_id)]

    def fault_in_words(self, code):
        return protocol.fault_in_words(int(code)) or "none"

    def emulator(self, **parameters):
        return EmulatedGaitDrive.of(self, **parameters)
