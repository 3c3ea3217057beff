"""Emulated CubeMars boards with extended frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from blocks.actuators.cubemars import frames, models_v3
from blocks.actuators.emulated import Emulated
from cext.kernels.devices.cubemars import emulator as kernels
from graph import Device, Memory, Param


class Board(Emulated):
    """Common parts of the emulated boards."""

    report_rate = Param(
        0.0, "Hz", "rate of the reports; 0: one reply per command instead", min=0.0, max=500.0, fixed=True
    )
    torque_constant = Param(
        0.0, "N·m/A", "torque constant at the actuator's output; 0: the model's", min=0.0, fixed=True, kernel=False
    )
    pole_pairs = Param(
        0,
        "1",
        "pole pairs of the motor, which scale the reported speed; 0: the model's",
        min=0,
        fixed=True,
        kernel=False,
    )
    command_timeout = Param(
        0.0, "s", "time without a command after which it gives no current; 0: never", min=0.0, fixed=True
    )
    scales = Memory((0.0,) * 3, "rad and rad/s per code of the status, N·m per ampere, at the joint")
    board = Memory((0.0,) * 2, "1 if the board has force control, 1 if that mode must be entered")
    motion = Memory(
        (-1.0,) + (0.0,) * 8,
        "kind of command, target, velocity limit, acceleration limit, reference, torque, time of the next report, "
        "pending confirmation, 1 after a loss of power",
    )

    def configure(self) -> None:
        """Look up the model, and derive the scales of the status. Raises ValueError for an unknown model."""
        spec = self.find(self.model)
        if self.peak is None and spec.peak is None:
            self.peak = spec.wire_torque * self.gear_ratio
        super().configure()
        constant = self.torque_constant or spec.torque_constant
        self.scales = frames.scales(with_pole_pairs(spec, self.pole_pairs), self.gear_ratio, constant)

    def addresses(self) -> list[tuple[int, bool]]:
        """Return its id, which is extended."""
        return [(self.can_id, True)]


def with_pole_pairs(spec: Any, pole_pairs: int) -> Any:
    """Return a model with other pole pairs than the table's, unless `pole_pairs` is 0."""
    return replace(spec, pole_pairs=pole_pairs) if pole_pairs else spec


class EmulatedCubeMarsV3(Board, Device):
    """Emulated V3.0 board with force control and servo mode: outputs torque and reports its state.

    Torque is the drive's law of the last command, up to the peak torque, and zero until it is commanded, after a
    disable and while it has a fault. It needs no enable, unless `enter`; after a loss of power it reports that, and
    executes the next command. `EmulatedCubeMarsV3.of(robot["left/knee"])` emulates the drive of a robot's block.
    """

    enter = Param(False, "1", "whether force control must be entered with FF..FC", fixed=True, kernel=False)

    find = staticmethod(models_v3.find)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    def configure(self) -> None:
        super().configure()
        self.board = (1.0, float(self.enter))


class EmulatedCubeMarsServo(Board, Device):
    """Emulated board of any generation in servo mode: outputs torque and reports its state.

    The gains of the velocity and position loops are assumed, since the vendor's tool sets the real ones. A V3.0 board
    also has force control. `EmulatedCubeMarsServo.of(robot["left/knee"])` emulates the drive of a robot's block.
    """

    report_rate = Param(
        100.0, "Hz", "rate of the reports; 0: one reply per command instead", min=0.0, max=500.0, fixed=True
    )

    find = staticmethod(models_v3.find_in_servo_mode)
    kernel = kernels.drive
    decode = kernels.drive_decode
    encode = kernels.drive_encode

    @classmethod
    def of(cls, actuator: Any, **parameters: Any) -> EmulatedCubeMarsServo:
        same = ("bus", "can_id", "invert", "offset", "gear_ratio", "wake_shift", "report_rate", "torque_constant")
        return cls(actuator.model, **{name: getattr(actuator, name) for name in same} | parameters)

    def configure(self) -> None:
        super().configure()
        self.board = (float(self.spec.generation >= 3), 0.0)
