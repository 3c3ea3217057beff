"""What emulated drives share: their ports, and every failure of a drive."""

import math
from collections.abc import Iterable
from typing import Any

from blocks.actuators.joint import RANGES, Ranges
from graph import Input, Interval, Memory, Output, Param

ANSWERS, WORDS = 24, 4  # of cext/kernels/devices/drives.pxd


class Emulated:
    """Ports and parameters of an emulated drive: it takes commands, gives torque, and answers each frame with its
    state.

    A family gives `find` and the native kernel, encode and decode. Every input of a fault at zero is a healthy drive.
    """

    model = Param("", "1", "as for the actuator", required=True, dtype=str)
    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    can_id = Param(1, "1", "its id", min=1, max=255, fixed=True)
    invert = Param(False, "1", "whether the joint turns against the motor", fixed=True)
    offset = Param(
        0.0,
        "rad",
        "motor position where the joint is at zero, at the joint and the way the joint turns",
        min=-12.5,
        max=12.5,
        fixed=True,
    )
    gear_ratio = Ranges.gear_ratio
    peak = Param(
        None,
        "N·m",
        "torque it gives at the joint at most; the model's peak by default",
        above=0.0,
        dtype=float,
        fixed=True,
    )
    wake_shift = Param(
        None,
        "rad",
        "motor turn at the joint: what a power cycle can shift its reading by; the model's by default",
        dtype=float,
        min=0.0,
        fixed=True,
        kernel=False,
    )
    turns = Param(0, "1", "motor turns by which its reading is off from the start", fixed=True, kernel=False)
    trip_temperature: Param[Any] = Param(
        math.inf, "°C", "temperature at which it protects itself with a fault", fixed=True
    )
    wire_position, wire_velocity, wire_stiffness = Ranges.wire_position, Ranges.wire_velocity, Ranges.wire_stiffness
    wire_damping, wire_torque, at_joint = Ranges.wire_damping, Ranges.wire_torque, Ranges.at_joint

    position = Input("rad", "of the joint")
    velocity = Input("rad/s", "of the joint")
    temperature = Input("°C", "of the drive", default=30.0)
    fault = Input("1", "error code it reports", default=0, dtype=int)
    silent = Input("1", "whether it obeys without answering", default=False, dtype=bool)
    dropped = Input("1", "share of the frames to and from it that get lost, 0 to 1", default=0.0)
    wrong_id = Input("1", "id it answers with instead of its own; 0 for its own", default=0, dtype=int)
    stuck_encoder = Input("1", "its encoder stays where it is", default=False, dtype=bool)
    delay = Input("s", "by which its answers are late", default=0.0)
    power_lost = Input(
        "1",
        "whether it has no power; afterwards its settings are lost, and its reading is within a motor turn of zero",
        default=False,
        dtype=bool,
    )
    torque = Output("N·m", "at the joint")
    enabled = Output("1", "whether it has been enabled", dtype=bool)
    wire = Memory(0.0, "half ranges on the wire, at the joint: position, velocity, stiffness, damping, torque")
    command = Memory((0.0,) * 5, "position, velocity, stiffness, damping, torque of the last command")
    state = Memory(
        (0.0,) * 7,
        "enabled, zero of the encoder, luck of frames, position of a stuck encoder, whether it is, time "
        "of the last command, a motor turn",
    )
    outbox = Memory((0.0,) * (2 + ANSWERS * WORDS), "answers that are owed")

    feedthrough: Iterable[str] | None = (
        "position",
        "velocity",
        "temperature",
        "fault",
        "silent",
        "dropped",
        "wrong_id",
        "stuck_encoder",
        "delay",
        "power_lost",
    )

    @classmethod
    def of(cls: Any, actuator: Any, **parameters: Any) -> Any:
        """The emulator of one block of a robot.

        parameters : what differs from it. With other ranges of the wire it plays a drive whose firmware does not match
            the table.
        """
        same = ("bus", "can_id", "invert", "offset", "gear_ratio", "wake_shift", *(f"wire_{name}" for name in RANGES))
        return cls(actuator.model, **{name: getattr(actuator, name) for name in same} | parameters)

    find: Any  # model of a name

    def configure(self):
        self.spec = self.find(self.model)
        self.wire = self.at_joint(self.spec)
        if self.peak is None:
            self.peak = self.spec.peak * self.gear_ratio
        shift = self.spec.wake_shift / self.gear_ratio if self.wake_shift is None else self.wake_shift
        self.state = (0.0, -self.turns * shift, 0.0, 0.0, 0.0, 0.0, shift)

    def output_range(self, **inputs):
        peak: Any = self.peak
        return {"torque": Interval(-peak, peak), "enabled": Interval(0.0, 1.0)}
