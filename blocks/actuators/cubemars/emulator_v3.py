"""CubeMars boards that are not there, as far as they speak in extended frames."""

from dataclasses import replace

from blocks.actuators.cubemars import frames, models_v3
from blocks.actuators.emulated import Emulated
from cext.kernels.devices.cubemars import emulator as kernels
from graph import Device, Memory, Param


class Boards:
    """What the emulated boards share. Taken over one by one, behind the items of every emulated drive."""

    report_rate = Param(
        0.0, "Hz", "at which it reports; 0 where it answers each command", min=0.0, max=500.0, fixed=True
    )
    torque_constant = Param(
        0.0, "N·m/A", "at the actuator's output; 0 for the table's", min=0.0, fixed=True, kernel=False
    )
    pole_pairs = Param(
        0, "1", "of the motor, by which its speed is reported; 0 for the table's", min=0, fixed=True, kernel=False
    )
    scales = Memory((0.0,) * 3, "rad and rad/s of a code of its status, N·m of an ampere, at the joint")
    board = Memory((0.0,) * 2, "whether it knows force control, whether that needs to be entered")
    motion = Memory(
        (-1.0,) + (0.0,) * 8,
        "kind of command, target, fastest, hardest, reference, torque, next report, echo, whether it was dead",
    )


def with_pole_pairs(spec, pole_pairs):
    """A model with another motor than the table's, where `pole_pairs` is not 0."""
    return replace(spec, pole_pairs=pole_pairs) if pole_pairs else spec


class EmulatedCubeMarsV3(Emulated, Device):
    """A V3.0 board on the in-memory bus: it takes force control and servo mode, gives torque, and reports.

    Torque is the drive's law of the last command, up to the peak torque, and zero until it is commanded, after a
    disable and while it has a fault. It needs no enable, unless `enter`; after its power was lost it reports that, and
    obeys the next command. `EmulatedCubeMarsV3.of(robot["left/knee"])` plays the drive that a robot's block commands.
    """

    report_rate = Boards.report_rate
    enter = Param(False, "1", "whether it obeys force control only after FF..FC", fixed=True, kernel=False)
    torque_constant, pole_pairs = Boards.torque_constant, Boards.pole_pairs
    scales, board, motion = Boards.scales, Boards.board, Boards.motion

    find = staticmethod(models_v3.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self):
        self.spec = self.find(self.model)
        if self.peak is None and self.spec.peak is None:
            self.peak = self.spec.wire_torque * self.gear_ratio
        super().configure()
        self.scales = frames.scales(
            with_pole_pairs(self.spec, self.pole_pairs),
            self.gear_ratio,
            self.torque_constant or self.spec.torque_constant,
        )
        self.board = (1.0, float(self.enter))

    def addresses(self):
        return [(self.can_id, True)]


class EmulatedCubeMarsServo(Emulated, Device):
    """A board of any generation in servo mode, on the in-memory bus: it takes commands, gives torque and reports.

    The gains of its loops of velocity and position are ours: the vendor's are set with its tool. A V3.0 board
    takes force control, too. `EmulatedCubeMarsServo.of(robot["left/knee"])` plays the drive that a robot's block
    commands.
    """

    report_rate = Param(
        100.0, "Hz", "at which it reports; 0 where it answers each command", min=0.0, max=500.0, fixed=True
    )
    torque_constant, pole_pairs = Boards.torque_constant, Boards.pole_pairs
    scales, board, motion = Boards.scales, Boards.board, Boards.motion

    find = staticmethod(models_v3.find_in_servo_mode)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    @classmethod
    def of(cls, actuator, **parameters):
        same = ("bus", "can_id", "invert", "offset", "gear_ratio", "wake_shift", "report_rate", "torque_constant")
        return cls(actuator.model, **{name: getattr(actuator, name) for name in same} | parameters)

    def configure(self):
        self.spec = self.find(self.model)
        if self.peak is None and self.spec.peak is None:
            self.peak = self.spec.wire_torque * self.gear_ratio
        super().configure()
        constant = self.torque_constant or self.spec.torque_constant
        if constant is None:
            raise ValueError(
                f"the torque constant of {self.spec.name} is not published: pass torque_constant= in "
                "N·m/A, at its output"
            )
        self.scales = frames.scales(with_pole_pairs(self.spec, self.pole_pairs), self.gear_ratio, constant)
        self.board = (float(self.spec.generation >= 3), 0.0)

    def addresses(self):
        return [(self.can_id, True)]
