"""Common parts of actuators with their own driver board, commanded with torque, stiffness and damping."""

from __future__ import annotations

from blocks.actuators import deviations, law_figures
from blocks.actuators.drive import Drive
from blocks.actuators.pose import motion_of
from blocks.actuators.ranges import RANGES, Ranges, joint_scales
from blocks.actuators.requests import Requests
from cext.safety.thresholds import SCALE_TOLERANCE_WIRE_TORQUE
from graph import CommandReplies, Deviation, Input, Interval, Memory, Motion, Output, Param, TorqueBound

MAX_TRANSIT = 0.005  # s


class Law:
    """Commands of the law in the drive, and the parameters of its bound."""

    stop_damping = Param(
        1.0,
        "N·m·s/rad",
        "damping in the safe stop; reduced if the joint moves too fast for the torque limit",
        above=0.0,
        fixed=True,
        kernel=False,
    )
    max_acceleration = Param(
        500.0,
        "rad/s²",
        "joint acceleration up to which the torque limit holds with stiffness or damping in the drive",
        above=0.0,
        max=1e5,
        fixed=True,
    )

    max_transit = Param(
        MAX_TRANSIT,
        "s",
        "time from a command to its reply up to which the drive has stiffness and damping, or one period if that is "
        "longer; the run measures it",
        above=0.0,
        max=0.1,
        fixed=True,
    )

    position_command = Input("rad", "equilibrium angle θ₀", default=0.0)
    velocity_command = Input("rad/s", "reference velocity ω₀", default=0.0)
    torque_command = Input("N·m", "feed-forward torque τ_ff", default=0.0)
    stiffness_command = Input("N·m/rad", "stiffness K", default=0.0)
    damping_command = Input("N·m·s/rad", "damping B", default=0.0)


class Joint(Requests, Law, Ranges, Drive):
    """Ports, parameters and limits of an actuator: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    The limit bounds the drive's whole law for every motion of the joint with |α| <= max_acceleration, until a next
    frame that is one period late. If the law exceeds the limit, the commanded torque is sent as feed-forward, with the
    gains that the limit permits; with feedback older than two ticks, only torque_command is sent.
    cext/kernels/devices/drive_law.pxd describes the rule. **For a hard bound, command torque only.**

    A family defines `find`, which returns a model by its name, and the native encode and decode. It may change the
    defaults.
    """

    safe_stop = Param(
        "disable",
        "1",
        "safe stop: disable, or damp first if a free joint would let the wearer fall",
        choices=("disable", "damp"),
    )

    torque_sent = Output("N·m", "feed-forward torque of the frame, after limits, fade-in and quantisation")
    limited = Output("1", "ticks in which the law was changed to keep it within the torque limit", dtype=int)
    wire = Memory(0.0, "encoded half ranges at the joint: position, velocity, stiffness, damping, torque")
    limits: Memory = Memory(
        0.0,
        "limits of the commands, in the same order, and of the whole law; permitted fraction of stiffness and damping",
    )
    transit = Memory(
        (0.0,) * 3,
        "longest time from a command to its reply; times by which a sample may be older than `age`, where its transit "
        "cannot be measured and where replies may have become late, s",
    )
    sent = Memory(
        (0.0,) * 5,
        "position, velocity, stiffness, damping and torque of the last frame, decoded from its codes, at the joint",
    )

    hardware = (*Drive.hardware, "ranges", *(f"wire_{name}" for name in RANGES))
    sent_outputs: tuple[str, ...] = ("torque_sent", "limited")
    law_limit = ("limits", 5)
    limit_columns = (*Drive.limit_columns, *(f"wire_{name}" for name in RANGES))
    velocity_codes = 0xFFF  # steps of the velocity in its feedback

    def configure(self) -> None:
        """Look up the model, and derive the encoded ranges and limits at the joint. Raises ValueError."""
        spec = self.spec = self.find(self.model)
        self.model = spec.name
        self.wire = self.at_joint(spec)
        self.torque_limit = self.find_limit()
        # the joint's range is the encoded one, shifted by the offset; values beyond cannot be sent
        position = self.wire[0] - abs(self.offset)
        if position < 0.0:
            raise ValueError(
                f"offset {self.offset:g} rad is outside the drive's position range of ±{self.wire[0]:g} rad"
            )
        self.limits = (position, *self.wire[1:4], self.torque_limit, self.torque_limit, 1.0)
        self.damp_time = self.stop_time if self.safe_stop == "damp" else 0.0
        if self.stop_damping > self.wire[3] and (
            self.damp_time or self.stop_damping != type(self).parameters["stop_damping"].default
        ):
            raise ValueError(
                f"stop_damping must be at most the drive's {self.wire[3]:g} N·m·s/rad, got {self.stop_damping:g}"
            )
        self.check_temperatures()
        self.range = motion_of(self.range, self.wire[0] + abs(self.offset))
        self.check_pose()
        self.check_zero()

    def command_replies(self) -> CommandReplies:
        """Return how the drive answers commands: each once."""
        return CommandReplies(self.max_transit)

    def motion(self) -> Motion:
        """Return the monitored quantities of the motion for commands of torque, stiffness and damping."""
        return Motion(
            acceleration=self.max_acceleration,
            velocity_code=2.0 * self.wire[1] / self.velocity_codes,
            gains=("limits", 6),
            law="sent",
            torque_tolerance=1e-2 * SCALE_TOLERANCE_WIRE_TORQUE,
            **self.motion_of_any_mode(),
        )

    def command_limits(self) -> dict[str, Interval]:
        """Return the range in which each command must lie, {input: Interval}."""
        position, velocity, stiffness, damping, torque = self.limits[:5]
        return {
            "torque_command": Interval(-torque, torque),
            "position_command": Interval(-position, position),
            "velocity_command": Interval(-velocity, velocity),
            "stiffness_command": Interval(0.0, stiffness),
            "damping_command": Interval(0.0, damping),
        }

    def rating(self) -> str:
        """Return the source of the command limits as text."""
        source = f"{self.limit} torque" if isinstance(self.limit, str) else "its limit"
        return f"{source} and encoded ranges of {self.spec.name}"

    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound:
        """Return the bound: proved for torque only, with stiffness or damping under the assumption on acceleration."""
        stiffness, damping = commands["stiffness_command"], commands["damping_command"]
        limit = self.capped_limit
        if stiffness.high <= 0.0 and damping.high <= 0.0:
            return TorqueBound("proved", limit)
        law = law_figures.Law(
            limit,
            self.max_acceleration,
            period,
            stiffness & Interval(0.0, self.wire[2]),
            damping & Interval(0.0, self.wire[3]),
            self.max_transit,
        )
        return TorqueBound(
            "assumed", limit, f"while |α| <= {self.max_acceleration:g} rad/s²", self.max_acceleration, law.figures()
        )

    def deviations(self) -> list[Deviation]:
        """Return the Deviations from the table of the model: encoded ranges, gear, and properties of the model."""
        scales = joint_scales(self.gear_ratio)
        return [*deviations.of_ranges(self, scales), *deviations.of_sources(self, scales), *deviations.of_model(self)]

    def output_range(self, **commands: Interval) -> dict[str, Interval]:
        """Return the ranges of the outputs, as the replies encode them."""
        position = self.wire[0] + abs(self.offset)
        velocity, torque = self.wire[1], self.wire[4]
        return {
            "position": Interval(-position, position),
            "velocity": Interval(-velocity, velocity),
            "torque": Interval(-torque, torque),
            "torque_sent": Interval(-torque, torque),
            "limited": Interval(0.0),
            "temperature": Interval(-40.0, 215.0),
            "fault": Interval(0.0, 255.0),
            "age": Interval(0.0),
            "rms_torque": Interval(0.0),
        }
