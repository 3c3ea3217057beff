"""RobStride actuators and the CyberGear in the vendor's private protocol, on extended frames."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from blocks.actuators import deviations
from blocks.actuators.damping import damped_stop
from blocks.actuators.joint import Joint
from blocks.actuators.ranges import joint_scales
from blocks.actuators.robstride import frames, models, queries
from blocks.actuators.robstride.emulator import EmulatedRobStride
from blocks.actuators.robstride.models import TEMPERATURE
from blocks.actuators.robstride.parameters import PARAMETERS
from blocks.actuators.robstride.read_back import ReadBack
from cext.kernels.devices.robstride import private as kernels
from cext.safety.thresholds import SCALE_TOLERANCE_WIRE_TORQUE
from graph import (
    Actuator,
    CommandReplies,
    Deviation,
    Input,
    Interval,
    Memory,
    Motion,
    Output,
    Param,
    ReplyField,
    StopReply,
    TorqueBound,
)
from graph.device import UNIT_EXPECTED

if TYPE_CHECKING:
    from graph.device_data import DampedStop
    from graph.dialogue import Dialogue

RUN_MODES = {"operation": 0, "position": 1, "velocity": 2, "current": 3, "csp": 5}
POSITION_MODES = ("position", "csp")

# input of each mode other than operation control, and the output with the value sent
COMMANDS = {
    "position": Input("rad", "position command, reached with velocity_limit and acceleration"),
    "velocity": Input("rad/s", "velocity command"),
    "current": Input("A", "current of the motor, amplitude of a phase, in the direction of the joint"),
}
SENT = {
    "position": Output("rad", "position command after quantisation"),
    "velocity": Output("rad/s", "velocity command after quantisation"),
    "current": Output("A", "current command after fade-in and quantisation"),
}


class RobStride(ReadBack, Joint, Actuator):
    """RobStride actuator or CyberGear: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    (RobStride user manuals of 2026-04-28, section 4.) Feedback is from the previous tick; commands are sent at the end
    of a tick. In operation control without stiffness and damping, the drive outputs `torque_command` only. In the modes
    position, csp (cyclic position), velocity and current the drive has one input, `position_command`,
    `velocity_command` or `current_command`, and its current is limited to that of the torque `limit`. Mode and limits
    are written while the drive is stopped, and are lost at power-off. The drive stops itself when it has received
    nothing for `can_timeout`; the CyberGear cannot. Arming writes the mode, the limits and that time-out while the
    drive is stopped, reads them back, and enables the drive only if all are as written. It also reads the unique number
    of the drive: two numbers behind one id are an error, as is another number than that of a unit whose record was
    compared. Faults are never cleared.
    """

    can_id = Param(127, "1", "CAN id set in the drive", min=1, max=127, fixed=True)
    host_id = Param(0xFD, "1", "id to which the drive replies", min=0, max=255, fixed=True)
    can_timeout = Param(
        0.1, "s", "time without a command after which the drive stops itself; 0 for never", min=0.0, max=5.0, fixed=True
    )
    active_reporting = Param(False, "1", "whether the drive also reports every 10 ms", fixed=True)
    velocity_limit = Param(
        2.0, "rad/s", "largest joint velocity in the modes position, csp and velocity", above=0.0, fixed=True
    )
    acceleration = Param(
        10.0,
        "rad/s²",
        "joint acceleration in the modes position and velocity; not for the CyberGear",
        above=0.0,
        fixed=True,
    )
    mode = Param(
        "operation",
        "1",
        "controlled quantity; operation: torque, stiffness and damping",
        choices=tuple(RUN_MODES),
        fixed=True,
    )

    warning = Output("1", "warnings of the newest fault report, as bits", dtype=int)
    state = Memory((0.0,) * 2, "replies since the drive stopped, reported faults")
    written = Memory(
        (0.0,) * 5,
        "index of the command, its scale, 1 if the offset applies to it, index and value of the current limit",
    )

    settings = Memory((0.0,) * 25, "number of the settings that arming writes; index, type and value of each")
    read_back = Memory(
        (0.0,) * 5,
        "1 once the drive has returned every setting, bits of those returned, number of different reads in a row, "
        "place and raw value of that setting",
    )

    arrival = Memory(0.0, "arrival of its newest frame in s")
    unique = Memory(
        (0.0,) * 3,
        "1 once the drive's unique number was read; 2 if arming expects it, 3 once it has; both halves of that number",
    )

    hardware = (*Joint.hardware, "host_id")
    find = staticmethod(models.find)
    decode = kernels.decode
    encode = kernels.encode_operation
    velocity_codes = 0xFFFF
    reports_enabled = True

    def configure(self) -> None:
        self.inputs, self.outputs, self.sent_outputs = type(self).inputs, type(self).outputs, type(self).sent_outputs
        self.encode = type(self).encode
        super().configure()
        if self.can_id == self.host_id:
            raise ValueError(f"can_id and host_id are both {self.can_id}: the drive and its host need different ids")
        if self.spec.is_cybergear:
            if self.mode == "csp":
                raise ValueError("the CyberGear has no mode csp; its mode position is commanded in the same way")
            if self.active_reporting:
                raise ValueError("the CyberGear has no periodic reports: omit active_reporting")
        self.unanswered_frames = int(self.active_reporting)
        self.own_timeout = self.can_timeout if self.spec.own_timeout and self.can_timeout > 0.0 else None
        self.ready = "read_back"
        # one read more beside its reports, and arming is complete before a second drive with this id shows
        reads = 2 if self.mode == "operation" and not self.active_reporting else 1
        self.compared = (frames.MECH_POS, frames.MECH_VEL)[: reads * self.verify_ranges]
        self.motor_torque = self.torque_limit / self.gear_ratio
        most = (
            self.spec.rated_current
            if self.torque_limit <= self.spec.rated * self.gear_ratio
            else self.spec.peak_current
        )
        self.current_limit = min(self.motor_torque / self.spec.torque_constant, most)
        if self.mode == "position" and self.zero_at_arming:
            raise ValueError("in mode position the drive does not set its zero: use mode csp, or omit zero_at_arming")
        if self.mode != "operation":
            if self.damp_time:
                raise ValueError(
                    f"safe_stop='damp' needs operation control: in mode {self.mode} the drive has no damping to command"
                )
            self.take_one_command()
        self.settings = frames.settings_of(self.written_settings())

    def take_one_command(self) -> None:
        """Set the input of a parameter mode, its limit, and its encoding."""
        quantity = "position" if self.mode in POSITION_MODES else self.mode
        if quantity != "current" and self.velocity_limit > self.wire[1]:
            raise ValueError(
                f"velocity_limit {self.velocity_limit:g} rad/s is outside the drive's range at the joint, "
                f"±{self.wire[1]:g} rad/s"
            )
        self.command_name, self.sent_name = f"{quantity}_command", f"{quantity}_sent"
        self.inputs = {self.command_name: COMMANDS[quantity].named(self.command_name)}
        # no input `zero` in the position and velocity modes, in which the torque may differ from zero
        self.inputs |= {name: type(self).inputs[name] for name in ("zero", "disable")[quantity != "current" :]}
        self.outputs = {
            name if name != "torque_sent" else self.sent_name: port
            if name != "torque_sent"
            else SENT[quantity].named(self.sent_name)
            for name, port in type(self).outputs.items()
        }
        self.sent_outputs = (self.sent_name,)
        self.encode = kernels.encode_written.renamed(command=self.command_name, command_sent=self.sent_name)
        limit = {"position": self.limits[0], "velocity": self.velocity_limit, "current": self.current_limit}[quantity]
        self.limits, self.law_limit = (limit, 1.0), ("limits", 1)
        limited = (0.0, 0.0) if quantity == "current" else (frames.LIMIT_CUR, self.current_limit)
        index = {"position": frames.LOC_REF, "velocity": frames.SPD_REF, "current": frames.IQ_REF}[quantity]
        self.written = (
            index,
            1.0 if quantity == "current" else self.gear_ratio,
            float(quantity == "position"),
            *limited,
        )

    def command_replies(self) -> CommandReplies:
        """Return how the drive answers commands: parameters that are read without a sample."""
        return CommandReplies(self.max_transit, to_set_up=len(self.set_up_frames()) - len(self.read_frames()))

    def motion(self) -> Motion:
        """Return the monitored quantities of the motion: in the position and velocity modes without the torque."""
        if self.mode == "operation":
            return super().motion()
        current = "current_sent" if self.mode == "current" else None
        return Motion(
            **self.motion_of_any_mode(),
            current=current,
            current_scale=self.spec.torque_constant * self.gear_ratio,
            torque_tolerance=1e-2 * SCALE_TOLERANCE_WIRE_TORQUE,
        )

    def prepare(self, dt: float | None) -> None:
        if dt is not None and 0.0 < self.can_timeout < 2.0 * dt and self.spec.own_timeout:
            raise ValueError(
                f"can_timeout {self.can_timeout:g} s is shorter than two ticks of {dt:g} s: the drive would stop "
                "itself between two commands"
            )

    def command_limits(self) -> dict[str, Interval]:
        if self.mode == "operation":
            return super().command_limits()
        return {self.command_name: Interval(-self.limits[0], self.limits[0])}

    def rating(self) -> str:
        if self.mode in ("position", "csp"):
            return f"encoded range of {self.spec.name}"
        if self.mode == "velocity":
            return "its velocity_limit"
        return super().rating() if self.mode == "operation" else f"current of the torque limit of {self.spec.name}"

    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound:
        if self.mode == "operation":
            return super().torque_bound(commands, period)
        if self.mode == "current":
            return TorqueBound("proved", self.torque_limit)
        return TorqueBound(
            "drive",
            self.torque_limit,
            f"by the drive's own current limit of {self.current_limit:.3g} A, which is not verified",
            setting="mode",
        )

    def deviations(self) -> list[Deviation]:
        """Return the Deviations from the table of the model; the modes with a current use the torque constant."""
        if self.mode == "operation":
            return super().deviations()
        constant = deviations.of_constant(self, self.spec.torque_constant, True)
        ranges = deviations.of_ranges(self, joint_scales(self.gear_ratio), law=False)
        return [*constant, *ranges, *deviations.of_model(self, "torque_constant")]

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        ranges = super().output_range() | {
            "temperature": TEMPERATURE,
            "fault": Interval(0.0, 2.0**44),
            "warning": Interval(0.0, 2.0**32),
        }
        if self.mode != "operation":
            sent = ranges.pop("torque_sent")
            sent = self.limits[0] * (1.0 + 1e-6)  # rounded to single precision, offset and all
            ranges[self.sent_name] = Interval(-sent - abs(self.offset) * 1e-6, sent + abs(self.offset) * 1e-6)
        return ranges

    def addresses(self) -> list[tuple[int, bool]]:
        return [(self.can_id, True)]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        """Return patterns of the frames of this drive to its host, and of frames to it."""
        unique = (self.can_id << 8 | frames.NEWCOMER, 0x1F00FFFF, True)
        return [(self.can_id << 8 | self.host_id, 0xFFFF, True), (self.can_id, 0xFF, True), unique]

    def feedback_frames(self, kind: int) -> tuple[tuple[int, int, bool, bytes], ...]:
        """Return its frames with its state. kind : FEEDBACK, its replies, or REPORT, those that it sends by itself"""
        return ((kind << 24 | self.can_id << 8 | self.host_id, 0x1F00FFFF, True, b""),)

    def stop_reply(self) -> StopReply:
        """Return the StopReply: a torque near zero in the mode of a drive that is not enabled."""
        replies, half = self.feedback_frames(frames.FEEDBACK), self.wire[4]
        return StopReply(
            replies,
            unasked=self.feedback_frames(frames.REPORT),
            length=8,
            torque=ReplyField(replies, first=32, bits=16, low=-half, high=half),
            rest=self.rest_torque(2.0 * half / 0xFFFF),
            disabled=(frames.MODE_BITS, 0),
        )

    def commanded_torque(self) -> ReplyField | None:
        """Return the field of the torque, in the identifier of operation control."""
        if self.mode != "operation":
            return None
        command = ((frames.OPERATION << 24 | self.can_id, 0x1F0000FF, True, b""),)
        return ReplyField(command, first=-24, bits=16, low=-self.wire[4], high=self.wire[4])

    def traffic(self) -> list[tuple[int, bool]]:
        count = 1 if self.mode in ("operation", "current") else 2
        return [(8, True)] * (2 * count)

    def write(self, index: int, value: float) -> tuple[int, bool, bytes]:
        """Return the frame that writes a parameter. index : index of the parameter"""
        return frames.write(index, value, self.can_id, self.host_id)

    def command(self, kind: int) -> tuple[int, bool, bytes]:
        """Return a frame without data. kind : kind of the command"""
        return frames.frame(kind, self.host_id, self.can_id)

    def written_settings(self) -> list[tuple[int, float]]:
        """Return (index, value) of the settings that arming writes and reads back; commands of zero are among them."""
        spec, ratio = self.spec, self.gear_ratio
        written: list[tuple[int, float]] = (
            [(frames.CAN_TIMEOUT, frames.timeout_counts(self.can_timeout))] if self.own_timeout else []
        )
        written += [(frames.RUN_MODE, RUN_MODES[self.mode]), (frames.LIMIT_TORQUE, self.capped_limit / self.gear_ratio)]
        if self.mode in POSITION_MODES:
            faster = frames.VEL_MAX if self.mode == "position" and not spec.is_cybergear else frames.LIMIT_SPD
            written.append((faster, self.velocity_limit * ratio))
        if self.mode in ("position", "velocity") and not spec.is_cybergear:
            written.append((frames.ACC_SET if self.mode == "position" else frames.ACC_RAD, self.acceleration * ratio))
        if self.mode != "operation":
            written.append((frames.IQ_REF if self.mode == "current" else frames.LIMIT_CUR, 0.0))
        return written

    def read_parameter(self, name: str) -> Dialogue:
        return queries.value(self.can_id, PARAMETERS[name], self.spec.is_cybergear)

    def ask_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the stop, which reports the state and leaves a running drive without torque."""
        return [self.command(frames.STOP)]

    def set_up_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return frames that stop the drive, write its settings and read them back."""
        sequence = [self.command(frames.STOP)]
        if self.spec.own_timeout and not self.own_timeout:
            sequence.append(self.write(frames.CAN_TIMEOUT, 0))
        sequence += [self.write(index, value) for index, value in self.written_settings()]
        if self.active_reporting:
            sequence.append(frames.reports(True, self.can_id, self.host_id))
        return [*sequence, *self.read_frames()]

    def read_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the reads of what is compared and of the settings, and the request of the unique number."""
        return [
            self.command(frames.GET_ID),
            *(
                frames.read(index, self.can_id, self.host_id)
                for index in (*self.compared, *(index for index, _ in self.written_settings()))
            ),
        ]

    def unit_memory(self, serial: str) -> dict[str, tuple[float, ...]]:
        low, high = struct.unpack("<II", bytes.fromhex(serial))
        return {"unique": (UNIT_EXPECTED, float(high), float(low))}

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [self.command(frames.ENABLE)]

    def set_zero_frame(self) -> tuple[int, bool, bytes]:
        """Return the frame that makes the present position of the drive its zero."""
        return frames.set_zero(self.can_id, self.host_id)

    def zero_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return a frame of zero torque: the command, or a current limit of zero in modes without a torque command."""
        if self.mode == "operation":
            return [(frames.OPERATION << 24 | 0x7FFF << 8 | self.can_id, True, bytes.fromhex("7fff7fff00000000"))]
        return [self.write(frames.IQ_REF if self.mode == "current" else frames.LIMIT_CUR, 0.0)]

    def disable_frames(self) -> list[tuple[int, bool, bytes]]:
        stopped = [self.command(frames.STOP)]
        return [*stopped, frames.reports(False, self.can_id, self.host_id)] if self.active_reporting else stopped

    def damped_stop(self) -> DampedStop | None:
        replies = self.feedback_frames(frames.FEEDBACK) + self.feedback_frames(frames.REPORT)
        velocity = ReplyField(replies, first=16, bits=16, low=-self.wire[1], high=self.wire[1])
        return damped_stop(self, self.damping_frames, velocity)

    def damping_frames(self, damping: float) -> list[tuple[int, bool, bytes]]:
        """Return the frame that damps the joint. damping : N·m·s/rad"""
        code = int(damping / self.wire[3] * 0xFFFF)
        return [
            (
                frames.OPERATION << 24 | 0x7FFF << 8 | self.can_id,
                True,
                bytes.fromhex("7fff7fff0000") + code.to_bytes(2, "big"),
            )
        ]

    def fault_in_words(self, code: int) -> str:
        meanings, code = frames.meanings(self.spec.is_cybergear), int(code)
        if not code & frames.DIFFERENT:
            return frames.in_words(code, meanings)
        value = code >> frames.REPORTED & 0xFFFFFFFF
        if code >> frames.PLACE in frames.COMPARED:
            return frames.disagreement(self, code >> frames.PLACE, value)
        differs = frames.difference(self.written_settings(), code >> frames.PLACE, value)
        others = frames.in_words(code & (frames.DIFFERENT - 1), meanings)
        return "; ".join([differs, *[others] * bool(others), self.remedy()])

    def warnings_in_words(self) -> tuple[str, ...]:
        family = "CyberGear" if self.spec.is_cybergear else "RobStride"
        meanings = frames.meanings(self.spec.is_cybergear)
        return tuple(f"{family} warning: {frames.warning_in_words(bit, meanings)}" for bit in range(32))

    def remedy(self) -> str:
        """Return what to do about a drive that does not keep what was written to it."""
        return (
            "its limits do not hold. Check which program or firmware writes to the drive, and update its firmware"
            + (
                f"; without a time-out in it (can_timeout is {self.can_timeout:g} s), set can_timeout=0 and rely on "
                "the guardian alone"
                if self.own_timeout
                else ""
            )
        )

    def unready_in_words(self) -> str:
        names = ", ".join(f"{frames.NAMES[index]} 0x{index:04X}" for index, _ in self.written_settings())
        return f"it answers, but not every read of its settings (type 17: {names}); {self.remedy()}"

    def emulator(self, **parameters: Any) -> EmulatedRobStride:
        return EmulatedRobStride.of(self, **parameters)
