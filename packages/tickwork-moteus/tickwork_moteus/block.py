"""moteus controllers in position mode."""

from __future__ import annotations

from typing import Any

from blocks.actuators.joint import Joint
from graph import Actuator, CommandReplies, Interval, Param, ReplyField, StopReply
from tickwork_moteus import kernels, models, protocol
from tickwork_moteus.emulator import EmulatedMoteus


class Moteus(Joint, Actuator):
    """moteus controller in position mode: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    Each command states its gains as fractions of the drive's kp and kd, the largest permitted torque, which is `limit`,
    and its time-out. Position, velocity and torque are those of the drive's output, after the reducer that it knows
    (motor_position.rotor_to_output_ratio); `gear_ratio` is a further gear. The vendor's register reference states that
    the drive limits the fraction of kd to that of kp: damping without stiffness may have no effect.
    """

    can_id = Param(1, "1", "CAN id set in the drive, id.id", min=1, max=127, fixed=True)
    safe_stop = Param("disable", "1", "safe stop: damping without stiffness may have no effect", choices=("disable",))
    can_timeout = Param(
        0.1,
        "s",
        "time without a command after which the drive stops itself, register 0x27",
        min=0.001,
        max=32.0,
        fixed=True,
    )
    restart_time = Param(
        0.02,
        "s",
        "shortest silence in which the drive may restart, after which it obeys again without being enabled",
        min=0.0,
        max=1.0,
        fixed=True,
        kernel=False,
    )

    examples = (
        {"model": "moteus-n1", "limit": 2.0},
        {"model": "r4.11", "limit": 5.0, "gear_ratio": 6.0, "invert": True},
    )
    reports_enabled = True
    find = staticmethod(models.find)
    decode = kernels.decode
    encode = kernels.encode

    def configure(self) -> None:
        super().configure()
        self.own_timeout = self.can_timeout

    def prepare(self, dt: float | None) -> None:
        if dt is not None and self.can_timeout < 3.0 * dt:
            raise ValueError(
                f"can_timeout {self.can_timeout:g} s is shorter than three ticks of {dt:g} s: the drive would stop "
                "itself between two commands"
            )

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        return super().output_range() | {"temperature": Interval(-127.0, 127.0), "fault": Interval(-128.0, 127.0)}

    def traffic(self) -> list[tuple[int, bool]]:
        """Return the command of 48 bytes and the reply of 24 bytes of a tick."""
        return [(48, True), (24, self.can_id > 7)]

    def addresses(self) -> list[tuple[int, bool]]:
        """Return the id of its commands."""
        return [(0x8000 | self.can_id, True)]

    def displayed_addresses(self) -> list[int]:
        return [self.can_id]

    def acceptance_filters(self) -> list[tuple[int, int, bool]]:
        """Return the filters of its replies, and of frames to it from other hosts."""
        return [*(frame[:3] for frame in self.reply_frames()), (self.can_id, 0xFF, False), (self.can_id, 0xFF, True)]

    def reply_frames(self) -> list[tuple[int, int, bool, bytes]]:
        """Return its replies, in the extended format and, up to id 7, also in the standard one."""
        source = self.can_id << 8
        standard = [(source, 0x7FF, False, protocol.HEAD)] if source <= 0x7FF else []
        return [*standard, (source, 0x1FFFFFFF, True, protocol.HEAD)]

    def stop_reply(self) -> StopReply:
        """Return what confirms a safe stop: a torque near zero, and mode 0 or 1."""
        frames, unit = tuple(self.reply_frames()), 1e-3 * self.gear_ratio
        torque = ReplyField(frames, 120, 32, -(2.0**31) * unit, (2.0**31 - 1.0) * unit, signed=True, little_endian=True)
        mode = ReplyField(frames, 24, 8, -1.0, 254.0)
        return StopReply(frames, length=24, torque=torque, rest=self.rest_torque(unit), enabled=mode)

    def commanded_torque(self) -> ReplyField:
        """Return the field of the feed-forward torque in its commands."""
        [(identifier, extended, _)] = self.enable_frames()
        command, unit = ((identifier, 0x1FFFFFFF, extended, b"\x01\x00\x0a\x08\x06\x20"),), 1e-3 * self.gear_ratio
        return ReplyField(command, 112, 32, -(2.0**31) * unit, (2.0**31 - 1.0) * unit, signed=True, little_endian=True)

    def command_replies(self) -> CommandReplies:
        return CommandReplies(self.max_transit, restart_time=self.restart_time)

    def ask_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the query: a stop would clear the fault that arming is to show."""
        return [protocol.query(self.can_id)]

    def set_up_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the stop, by which the drive leaves the time-out of an earlier run."""
        return self.disable_frames()

    def enable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [protocol.nothing(self.can_id, round(1e3 * self.can_timeout))]

    def zero_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the query: the frame that enables the drive commands no torque, and the stop removes it."""
        return [protocol.query(self.can_id)]

    def disable_frames(self) -> list[tuple[int, bool, bytes]]:
        return [protocol.stop(self.can_id)]

    def set_zero_frame(self) -> tuple[int, bool, bytes]:
        """Return the frame that makes the present position of the drive its zero."""
        return protocol.set_zero(self.can_id)

    def fault_in_words(self, code: float) -> str:
        return protocol.in_words(int(code)) if code else "none"

    def emulator(self, **parameters: Any) -> EmulatedMoteus:
        return EmulatedMoteus.of(self, **parameters)
