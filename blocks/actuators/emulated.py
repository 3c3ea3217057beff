"""Common ports of emulated drives, including every injected fault."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from blocks.actuators.pose import Pose
from blocks.actuators.ranges import RANGES, Ranges
from graph import Input, Interval, Memory, Output, Param

ANSWERS, WORDS = 24, 4  # of cext/kernels/devices/drives.pxd


class Emulated(Ranges):
    """Ports and parameters of an emulated drive, which outputs torque and replies to each command with its state.

    A family defines `find` and the native kernel, encode and decode. With every fault input at zero, the drive is
    healthy.
    """

    positional: tuple[str, ...] | None = ("model", "bus", "can_id")

    model = Param("", "1", "model in the vendor's spelling", required=True, dtype=str)
    bus = Param("can", "1", "logical name of the CAN bus", dtype=str)
    can_id = Param(1, "1", "CAN id of the drive", min=1, max=255, fixed=True)
    invert, offset = Pose.invert, Pose.offset
    peak = Param(
        None, "N·m", "largest torque at the joint; the model's peak by default", above=0.0, dtype=float, fixed=True
    )
    wake_shift = Param(
        None,
        "rad",
        "motor turn at the joint, by which a power cycle can shift the reading; the model's by default",
        dtype=float,
        min=0.0,
        fixed=True,
        kernel=False,
    )
    turns = Param(0, "1", "initial error of the reading in motor turns", fixed=True, kernel=False)
    torque_scale = Param(
        1.0,
        "1",
        "torque of the motor over the torque that the drive computes and reports, as with another torque constant; "
        "negative: against its encoder",
        fixed=True,
    )
    wrap = Param(
        0.0, "rad", "range of the reading, which wraps, as 2π of a drive without turns; 0: none", min=0.0, fixed=True
    )
    zero_silence = Param(
        0.0, "s", "time for which the drive neither receives nor replies after its zero was set", min=0.0, fixed=True
    )
    trip_temperature: Param[Any] = Param(math.inf, "°C", "temperature of the over-temperature fault", fixed=True)

    position = Input("rad", "position of the joint")
    velocity = Input("rad/s", "velocity of the joint")
    temperature = Input("°C", "temperature of the drive", default=30.0)
    fault = Input("1", "reported error code", default=0, dtype=int)
    silent = Input("1", "whether the drive executes commands without a reply", default=False, dtype=bool)
    dropped = Input("1", "fraction of lost frames in both directions, 0 to 1", default=0.0)
    wrong_id = Input("1", "id in replies instead of `can_id`; 0 for none", default=0, dtype=int)
    stuck_encoder = Input("1", "whether the encoder reading is frozen", default=False, dtype=bool)
    delay = Input("s", "delay of the replies", default=0.0)
    power_lost = Input(
        "1",
        "whether the supply is off; afterwards settings are lost and the reading is within one motor turn of zero",
        default=False,
        dtype=bool,
    )
    stray_torque = Input(
        "N·m", "torque that the drive produces and reports in addition to its law, also disabled", default=0.0
    )
    torque = Output("N·m", "torque at the joint")
    enabled = Output("1", "whether the drive is enabled", dtype=bool)
    wire = Memory(0.0, "encoded half ranges at the joint: position, velocity, stiffness, damping, torque")
    command = Memory((0.0,) * 5, "position, velocity, stiffness, damping, torque of the last command")
    state: Memory = Memory(
        (0.0,) * 8,
        "1 if enabled, zero of the encoder, random state, position of a stuck encoder, 1 if it is stuck, time of the "
        "last command, motor turn at the joint, end of the silence after its zero was set",
    )
    outbox = Memory((0.0,) * (2 + ANSWERS * WORDS), "pending replies")

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
        "stray_torque",
    )

    @classmethod
    def of(cls: Any, actuator: Any, **parameters: Any) -> Any:
        """Return the emulator of a robot's block.

        parameters : those that differ from the block's. Other encoded ranges emulate a drive whose firmware does not
            match the table.
        """
        wires = (f"wire_{name}" for name in RANGES)
        same = ("bus", "can_id", "invert", "offset", "gear_ratio", "wake_shift", "ranges", *wires)
        return cls(actuator.model, **{name: getattr(actuator, name) for name in same} | parameters)

    find: Any  # function of a name that returns a model

    def configure(self) -> None:
        """Look up the model, and set the position after the power cycle. Raises ValueError for an unknown model."""
        self.spec = self.find(self.model)
        self.wire = self.at_joint(self.spec)
        if self.peak is None:
            self.peak = self.spec.peak * self.gear_ratio
        shift = self.spec.wake_shift / self.gear_ratio if self.wake_shift is None else self.wake_shift
        self.state = (0.0, -self.turns * shift, 0.0, 0.0, 0.0, 0.0, shift, 0.0)

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        """Return the ranges of torque and enabled."""
        peak: Any = self.peak
        peak *= abs(self.torque_scale)
        return {"torque": Interval(-peak, peak), "enabled": Interval(0.0, 1.0)}
