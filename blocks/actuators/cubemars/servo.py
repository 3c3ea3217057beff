"""CubeMars actuators in servo mode, available on boards of all generations."""

from __future__ import annotations

import math
from typing import Any

from msgspec.structs import replace

from blocks.actuators import deviations
from blocks.actuators.cubemars import frames, models_v3
from blocks.actuators.cubemars.emulator_v3 import EmulatedCubeMarsServo, with_pole_pairs
from blocks.actuators.cubemars.v3 import ExtendedFrames, Reporting
from blocks.actuators.drive import Drive, winding_of
from blocks.actuators.joint import MAX_TRANSIT
from blocks.actuators.pose import motion_of
from blocks.actuators.requests import Requests
from cext.kernels.devices.cubemars import servo as kernels
from cext.safety.thresholds import SCALE_TOLERANCE, STOP_DAMP_ROUND
from graph import (
    Actuator,
    DampedStop,
    Deviation,
    Input,
    Interval,
    Memory,
    Motion,
    Output,
    Param,
    ReplyField,
    TorqueBound,
    Winding,
)

KINDS = {
    "duty": frames.DUTY,
    "current": frames.CURRENT,
    "current_brake": frames.BRAKE,
    "velocity": frames.SPEED,
    "position": frames.POSITION,
    "position_velocity": frames.POSITION_SPEED,
}
CURRENTS = ("current", "current_brake")  # modes in which the command bounds the torque
POSITIONS = ("position", "position_velocity")

CURRENT, SPEED, POSITION = 60.0, 100_000.0, math.radians(3200.0)  # A, electrical revolutions a minute, rad of the motor
WORD, LONG = 32767, 360_000_000  # largest codes: 16 bits, and 36000° of a position

# input of each mode other than current, and the output with the value sent
COMMANDS = {
    "duty": (
        Input("1", "fraction of the supply voltage, in the direction of the joint"),
        Output("1", "duty after fade-in and rounding"),
    ),
    "current_brake": (
        Input("A", "braking current of the motor"),
        Output("A", "braking current after fade-in and rounding"),
    ),
    "velocity": (Input("rad/s", "velocity command"), Output("rad/s", "velocity command after fade-in and rounding")),
    "position": (Input("rad", "position command"), Output("rad", "position command after fade-in and rounding")),
}


class CurrentCommand:
    """The command of the current modes. A base class, so that it is the first input of the block."""

    current_command = Input("A", "current of the motor, in the direction of the joint")


class CubeMarsServo(ExtendedFrames, Reporting, Requests, CurrentCommand, Drive, Actuator):
    """CubeMars actuator in servo mode: the drive controls duty, current, velocity or position.

    (AK Series Module Driver Manual V1.0.18; AKA Series Product Manual V3.0.0, section 4.) A board V1 or V2 must be set
    to servo mode with the vendor's tool. Each mode has one input: `duty_command`, `current_command`,
    `current_brake_command`, `velocity_command`, or `position_command`. Only a current bounds the torque, to
    `limit`; in the other modes the current is limited only by the settings of the drive. Commands have no reply: a
    report counts as the answer. The safe stop commands zero current, and disables a V3.0 board. Reports of a current
    near zero confirm it, together with the answer of a V3.0 board to the disable. A board V1 or V2 has no disable.
    """

    mode = Param("current", "1", "controlled quantity", choices=tuple(KINDS), fixed=True)
    velocity_limit = Param(
        2.0,
        "rad/s",
        "largest joint velocity in the modes velocity and position_velocity",
        above=0.0,
        fixed=True,
        kernel=False,
    )
    acceleration = Param(
        10.0, "rad/s²", "largest joint acceleration in the mode position_velocity", above=0.0, fixed=True, kernel=False
    )
    duty_limit = Param(0.1, "1", "largest duty in the mode duty", above=0.0, max=1.0, fixed=True, kernel=False)
    torque_constant = Param(
        0.0, "N·m/A", "torque constant at the actuator's output; 0: the model's", min=0.0, fixed=True, kernel=False
    )
    pole_pairs = Param(
        0, "1", "pole pairs of the motor, which scale the velocity; 0: the model's", min=0, fixed=True, kernel=False
    )
    report_rate = Param(
        100.0,
        "Hz",
        "rate of the drive's reports, as set with the vendor's tool; 0 for a V3.0 board that answers each command",
        min=0.0,
        max=500.0,
        fixed=True,
        kernel=False,
    )
    max_transit: float = MAX_TRANSIT  # of reports, whose transit cannot be measured
    safe_stop = Param("disable", "1", "safe stop: disable, or brake first", choices=("disable", "brake"))
    stop_current = Param(1.0, "A", "braking current in the safe stop", above=0.0, max=CURRENT, fixed=True, kernel=False)
    rms_mode = Param(
        "disable",
        "1",
        "action when the RMS torque exceeds the rated torque; saturate and throttle require a current mode",
        choices=("silent", "warn", "saturate", "throttle", "disable"),
    )

    current_sent = Output("A", "current command after fade-in and rounding")
    limits = Memory((0.0,) * 3, "lowest and highest command, and its permitted fraction")
    written = Memory(
        (0.0,) * 5, "kind of the command, codes of its unit, largest code, codes of speed and acceleration"
    )

    limit_columns = (*Drive.limit_columns, "torque_constant")

    # not the torque constant: with another a rig could raise the current
    hardware = (*Drive.hardware, "report_rate", "pole_pairs", "drive_timeout")
    find = staticmethod(models_v3.find_in_servo_mode)
    decode = kernels.decode
    encode = kernels.encode.renamed(command="current_command", sent="current_sent")
    unread_settings = ("report rate", "current limit", "time-out")

    def configure(self) -> None:
        self.inputs, self.outputs = type(self).inputs, type(self).outputs
        spec = self.spec = with_pole_pairs(self.find(self.model), self.pole_pairs)
        self.model = spec.name
        constant = self.torque_constant or spec.torque_constant
        if spec.generation < 3 and self.report_rate == 0.0:
            raise ValueError(
                f"the board of {spec.name} does not answer commands in servo mode: pass the "
                "report_rate that is set in it"
            )
        self.range = motion_of(self.range, POSITION / self.gear_ratio + abs(self.offset))
        self.check_pose()
        self.check_zero()
        self.check_reports()
        self.check_temperatures()
        self.scales = frames.scales(spec, self.gear_ratio, constant)
        self.wire = (
            POSITION / self.gear_ratio,
            self.scales[1] * SPEED / frames.SPEED_CODE,
            0.0,
            0.0,
            CURRENT * self.scales[2],
        )
        self.torque_limit = self.find_limit()
        rated = spec.rated is None or self.torque_limit <= spec.rated * self.gear_ratio
        motor = spec.rated_current if rated else spec.peak_current
        self.current_limit = min(self.torque_limit / self.scales[2], CURRENT, math.inf if motor is None else motor)
        if self.mode not in CURRENTS and self.rms_mode in ("saturate", "throttle"):
            raise ValueError(
                f"rms_mode {self.rms_mode!r} requires a current mode, but the mode is {self.mode}: set warn or disable"
            )
        self.law_limit = ("limits", 2) if self.mode in CURRENTS else None
        self.damp_time = self.stop_time if self.safe_stop == "brake" else 0.0
        if self.damp_time and self.stop_current > self.current_limit:
            raise ValueError(
                f"stop_current must be at most the current of the limit, {self.current_limit:.4g} A, got "
                f"{self.stop_current:g}"
            )
        self.take_one_command()

    def take_one_command(self) -> None:
        """Set the input of the mode, its limits, and its encoding."""
        quantity = "position" if self.mode in POSITIONS else self.mode
        self.command_name, self.sent_name = f"{quantity}_command", f"{quantity}_sent"
        self.sent_outputs = (self.sent_name,)
        self.encode = kernels.encode.renamed(command=self.command_name, sent=self.sent_name)
        if quantity != "current":
            command, sent = COMMANDS[quantity]
            # without zero: the torque is unknown
            self.inputs = {self.command_name: command.named(self.command_name), "disable": type(self).inputs["disable"]}
            self.outputs = {
                self.sent_name if name == "current_sent" else name: sent.named(self.sent_name)
                if name == "current_sent"
                else port
                for name, port in type(self).outputs.items()
            }
        if self.mode in ("velocity", "position_velocity") and self.velocity_limit > self.wire[1]:
            raise ValueError(
                f"velocity_limit {self.velocity_limit:g} rad/s is outside the drive's range at the joint, "
                f"±{self.wire[1]:g} rad/s"
            )
        position = self.wire[0] - abs(self.offset)
        limit, scale, largest = {
            "duty": (self.duty_limit, 1e5, 100_000),
            "current": (self.current_limit, 1e3, 60_000),
            "current_brake": (self.current_limit, 1e3, 60_000),
            "velocity": (self.velocity_limit, frames.SPEED_CODE / self.scales[1], SPEED),
            "position": (position, math.degrees(1e4) * self.gear_ratio, LONG),
        }[quantity]
        self.limits = (0.0 if self.mode == "current_brake" else -limit, limit, 1.0)
        self.written = (KINDS[self.mode], scale, largest, *self.speeds())

    def speeds(self) -> tuple[float, float]:
        """Return the codes of the speed and acceleration limits of a position command, truncated."""
        if self.mode != "position_velocity":
            return 0.0, 0.0
        speed, acceleration = (math.floor(x / self.scales[1]) for x in (self.velocity_limit, self.acceleration))
        for name, code in (("velocity_limit", speed), ("acceleration", acceleration)):
            if not 0 < code <= WORD:
                raise ValueError(
                    f"{name} must be between {self.scales[1]:.3g} and {WORD * self.scales[1]:.3g}, the range "
                    f"of {self.spec.name} at the joint, got {getattr(self, name):g}"
                )
        return float(speed), float(acceleration)

    def motion(self) -> Motion:
        """Return the monitored quantities of the motion.

        A mode without a commanded current may exceed its limit, up to the peak torque.
        """
        motion = self.motion_of_any_mode() | {"position_code": self.scales[0]}
        if self.mode not in CURRENTS and self.spec.peak is not None:
            motion["limit"] = self.spec.peak * self.gear_ratio
        current = "current_sent" if self.mode == "current" else None
        return Motion(**motion, current=current, current_scale=self.scales[2], torque_tolerance=1e-2 * SCALE_TOLERANCE)

    def command_limits(self) -> dict[str, Interval]:
        return {self.command_name: Interval(self.limits[0], self.limits[1])}

    def rating(self) -> str:
        if self.mode in CURRENTS:
            return f"current of the torque limit of {self.spec.name}, and of its motor"
        return {"duty": "its duty_limit", "velocity": "its velocity_limit"}.get(
            self.mode, f"feedback range of {self.spec.name}"
        )

    def winding(self) -> Winding:
        """Return the currents of the motor: of a current mode, the largest current that is commanded."""
        if self.mode not in CURRENTS:
            return winding_of(self.spec, self.gear_ratio, None)
        return replace(winding_of(self.spec, self.gear_ratio, self.torque_limit), current=self.current_limit)

    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound:
        if self.mode in CURRENTS:
            return TorqueBound("proved", self.torque_limit)
        return TorqueBound(
            "none", None, f"in mode {self.mode} only the settings of the drive bound the torque", setting="mode"
        )

    def deviations(self) -> list[Deviation]:
        """Return the Deviations from the table of the model: torque constant, gear, and properties of the model."""
        constant = deviations.of_constant(self, self.scales[2] / self.gear_ratio, self.mode in CURRENTS)
        return [*constant, *deviations.of_model(self, "torque_constant")]

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        feedback = self.feedback_range()
        most = feedback["position"].high if self.mode in POSITIONS else self.limits[1] * (1.0 + 1e-9)
        return feedback | {
            "fault": Interval(0.0, 255.0),
            "age": Interval(0.0),
            "rms_torque": Interval(0.0),
            self.sent_name: Interval(-most, most),
        }

    def traffic(self) -> list[tuple[int, bool]]:
        return [(8 if self.mode == "position_velocity" else 4, True)] + [(8, True)] * self.reports_a_tick

    def zero_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return a command of zero current in every mode: a duty of zero would short the motor and brake it."""
        return [frames.amperes(frames.CURRENT, 0.0, self.can_id)]

    def commanded_torque(self) -> ReplyField | None:
        """Return the field of the current, in N·m."""
        if self.mode not in CURRENTS:
            return None
        identifier, extended, _ = frames.frame(KINDS[self.mode], self.can_id)
        command, unit = ((identifier, 0x1FFFFFFF, extended, b""),), 1e-3 * self.scales[2]
        return ReplyField(command, 0, 32, low=-(2**31) * unit, high=(2**31 - 1) * unit, signed=True)

    def ask_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the disable, or the command of zero current of a board without it."""
        return self.disable_frames()

    def disable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [frames.frame(frames.DISABLE, self.can_id)] if self.spec.generation >= 3 else self.zero_frames()

    def damped_stop(self) -> DampedStop | None:
        """Return the stop with a braking current, which bounds the torque at every speed."""
        if not self.damp_time:
            return None
        return DampedStop(
            duration=self.damp_time,
            bands=((math.inf, (frames.amperes(frames.BRAKE, self.stop_current, self.can_id),)),),
            velocity=None,
            acceleration=0.0,
            round=STOP_DAMP_ROUND * 1e-9,
            limit=self.stop_current * self.scales[2],
        )

    def emulator(self, **parameters: Any) -> EmulatedCubeMarsServo:
        return EmulatedCubeMarsServo.of(self, **parameters)
