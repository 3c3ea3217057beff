"""CubeMars actuators with a board of generation V3.0, in force control."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from blocks.actuators.cubemars import frames, models_v3
from blocks.actuators.cubemars.emulator_v3 import EmulatedCubeMarsV3
from blocks.actuators.cubemars.own_timeout import DeclaredTimeout
from blocks.actuators.damping import damped_stop
from blocks.actuators.joint import Joint
from blocks.actuators.mit_frames import ENABLE, torque_field
from cext.kernels.devices.cubemars import v3 as kernels
from cext.safety.thresholds import SCALE_TOLERANCE
from graph import Actuator, CommandReplies, Deviation, Interval, Memory, Output, Param, ReplyField, StopReply

if TYPE_CHECKING:
    from graph.device_data import DampedStop, Motion

# no stiffness, no damping; position, velocity and torque in the middle of their ranges
NOTHING = bytes.fromhex("0000007fff7ff7ff")


class Reporting(DeclaredTimeout):
    """Feedback of boards that report in extended frames, and its decoding."""

    report_rate = Param(
        0.0,
        "Hz",
        "rate of the drive's reports, as set with the vendor's tool; 0: one reply per command instead",
        min=0.0,
        max=500.0,
        fixed=True,
        kernel=False,
    )
    restart_time = Param(
        0.012,
        "s",
        "shortest silence in which the drive may have restarted, which ends the run, since it obeys without an enable; "
        "0 for never, if it was measured that the drive needs longer than `timeout` to restart",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    torque = Output("N·m", "torque computed from the drive's current and the torque constant")
    current = Output("A", "current of the motor, in the direction of the joint")
    scales = Memory((0.0,) * 3, "rad and rad/s per code of the feedback, N·m per ampere, at the joint")
    notice = Memory(0.0, "event that a commanded drive has reported")

    reports_a_tick: int
    timeout: Any
    offset: Any
    max_transit: Any

    def check_reports(self) -> None:
        """Raise ValueError if the timeout is shorter than two reports."""
        self.own_timeout = self.drive_timeout
        self.reports_a_tick = 1
        if self.report_rate > 0.0 and 0.0 < self.timeout < 2.0 / self.report_rate:
            raise ValueError(
                f"timeout {self.timeout:g} s is shorter than two reports at report_rate {self.report_rate:g} Hz: the "
                "drive would appear silent"
            )

    def command_replies(self) -> CommandReplies:
        """Return how the drive answers commands, or reports instead."""
        return CommandReplies(self.max_transit, self.report_rate, self.restart_time)

    def prepare(self, dt: float | None) -> None:
        """Compute the reports in a tick. dt : s"""
        self.check_timeout(dt)
        self.reports_a_tick = max(1, math.ceil(self.report_rate * dt)) if dt is not None else 1

    def feedback_range(self) -> dict[str, Interval]:
        """Return the ranges that its reports encode, {output: Interval}."""
        position, velocity = frames.DEGREES / 0.1 * self.scales[0] + abs(self.offset), 32768 * self.scales[1]
        torque = 327.68 * self.scales[2]
        return {
            "position": Interval(-position, position),
            "velocity": Interval(-velocity, velocity),
            "torque": Interval(-torque, torque),
            "current": Interval(-327.68, 327.68),
            "temperature": Interval(-128.0, 127.0),
        }

    def feedback_ends(self) -> tuple[float, ...]:
        """Return the ends of the feedback's range at the joint, rad and rad/s."""
        found = self.feedback_range()
        return found["position"].high - abs(self.offset), found["velocity"].high


class ExtendedFrames:
    """Addresses, frames and faults of a drive on extended frames."""

    can_id: Any
    spec: Any
    scales: Any
    rest_torque: Any

    def fault_in_words(self, code: int) -> str:
        """Return the text of a fault code."""
        return frames.in_words(code)

    def addresses(self) -> list[tuple[int, bool]]:
        """Return its id, which is extended."""
        return [(self.can_id, True)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        """Return the filters of its reports."""
        return frames.acceptance_filters(self.can_id)

    def set_zero_frame(self) -> tuple[int, bool, bytes]:
        """Return the frame that makes the present position of the drive its zero until the power is removed."""
        return frames.origin(self.can_id)

    def stop_reply(self) -> StopReply:
        """Return the StopReply: statuses of a current near zero, and of a V3.0 board the answer to the disable."""
        rest = self.rest_torque(0.0) / self.scales[2]
        return replace(frames.stop_reply(self.can_id, rest, self.spec.generation >= 3), unit=self.scales[2])


class CubeMarsV3(ExtendedFrames, Reporting, Joint, Actuator):
    """CubeMars actuator with a V3.0 board in force control: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (AKA Series Product Manual V3.0.0; AK Series Product Manual V3.2.0, section 4.) As CubeMars, on extended frames,
    with different feedback: position, velocity and current at `report_rate`. The feedback covers ± 3276.8° of a motor,
    commands ± 12.56 rad. The torque is computed from the current. With stiffness and damping, the drive must report at
    least every second tick: both are zero with older feedback. Reports of a current near zero, with the board's answer
    to the disable, confirm the safe stop.
    """

    unread_settings = ("report rate", "current limit")
    enter = Param(
        False,
        "1",
        "whether arming sends FF..FC, which one user's unit required; on a board without this command, it commands "
        "full torque",
        fixed=True,
        kernel=False,
    )

    hardware = (*Joint.hardware, "report_rate", "enter", "drive_timeout")
    find = staticmethod(models_v3.find)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self) -> None:
        super().configure()
        self.need_ranges(self.spec)
        self.check_reports()
        self.scales = frames.scales(self.spec, self.gear_ratio, self.spec.torque_constant)

    def deviations(self) -> list[Deviation]:
        """Return the Deviations from the table of the model and from the manual, which has no frame FF..FC."""
        found = super().deviations()
        if self.enter:
            effect = "a board that does not support FF..FC executes it as a command with every field at its maximum"
            found.append(Deviation("enter", "true", "false", "1", "the manual of V3.0 boards", effect))
        return found

    def motion(self) -> Motion:
        """Return the monitored quantities of the motion.

        They include the torque computed from the current, which verifies the torque constant.
        """
        return replace(
            super().motion(),
            position_code=self.scales[0],
            velocity_code=self.scales[1],
            torque_tolerance=1e-2 * SCALE_TOLERANCE,
        )

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        return super().output_range() | self.feedback_range()

    def traffic(self) -> list[tuple[int, bool]]:
        return [(8, True)] * (1 + self.reports_a_tick)

    def ask_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the disable, which a drive without periodic reports answers."""
        return self.disable_frames()

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [frames.frame(frames.FORCE, self.can_id, ENABLE)] if self.enter else []

    def zero_frames(self) -> list[tuple[int, bool, bytes]]:
        return [frames.frame(frames.FORCE, self.can_id, NOTHING)]

    def disable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [frames.frame(frames.DISABLE, self.can_id)]

    def commanded_torque(self) -> ReplyField:
        return torque_field(self.zero_frames()[0], self.wire[4])

    def damped_stop(self) -> DampedStop | None:
        return damped_stop(self, self.damping_frames, frames.velocity_field(self.can_id, self.scales[1]))

    def damping_frames(self, damping: float) -> list[tuple[int, bool, bytes]]:
        """Return the frame that damps the joint. damping : N·m·s/rad"""
        code = int(damping / self.wire[3] * 0xFFF)
        return [frames.frame(frames.FORCE, self.can_id, bytes([0, code >> 8, code & 0xFF, *NOTHING[3:]]))]

    def emulator(self, **parameters: Any) -> EmulatedCubeMarsV3:
        return EmulatedCubeMarsV3.of(self, **{"report_rate": self.report_rate, "enter": self.enter} | parameters)
