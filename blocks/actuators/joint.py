"""Common parts of actuators with their own driver board, commanded with torque, stiffness and damping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

from blocks.actuators import deviations, law_figures
from cext.safety.thresholds import SCALE_TOLERANCE, SCALE_TOLERANCE_WIRE_TORQUE, STOP_REST_TORQUE, TORQUE_ACCURACY
from graph import (
    CommandReplies,
    Deviation,
    Input,
    Interval,
    Memory,
    Motion,
    Output,
    Param,
    TorqueBound,
    Watch,
    Winding,
    Zeroing,
)
from graph.reach import Reach

MAX_TRANSIT = 0.005  # s
RANGES = ("position", "velocity", "stiffness", "damping", "torque")


def joint_scales(gear_ratio: float) -> tuple[float, ...]:
    """Return the factors that convert the five half ranges of a motor to the joint behind a gear."""
    return 1.0 / gear_ratio, 1.0 / gear_ratio, gear_ratio**2, gear_ratio**2, gear_ratio


class Ranges:
    """Parameters of the gear between motor and joint, and of the encoded ranges.

    Families copy them one by one instead of inheriting, since parameters can be passed by position.
    """

    gear_ratio = Param(
        1.0, "1", "ratio of a gear behind the actuator: motor angle over joint angle", above=0.0, max=1000.0, fixed=True
    )
    wire_position = Param(
        0.0,
        "rad",
        "half the encoded range of position, if the firmware differs from the table of the model; 0: the table's",
        min=0.0,
        fixed=True,
    )
    wire_velocity = Param(0.0, "rad/s", "half the encoded range of velocity; 0: the table's", min=0.0, fixed=True)
    wire_stiffness = Param(0.0, "N·m/rad", "largest encoded stiffness; 0: the table's", min=0.0, fixed=True)
    wire_damping = Param(0.0, "N·m·s/rad", "largest encoded damping; 0: the table's", min=0.0, fixed=True)
    wire_torque = Param(0.0, "N·m", "half the encoded range of torque; 0: the table's", min=0.0, fixed=True)

    def at_joint(self, spec: Any) -> tuple[float, ...]:
        """Return the five half ranges of a model, converted to the joint, so that kernels do not depend on the gear."""
        own = [getattr(self, f"wire_{name}") or getattr(spec, f"wire_{name}") for name in RANGES]
        return tuple(x * scale for x, scale in zip(own, joint_scales(self.gear_ratio)))


class Joint:
    """Ports, parameters and limits of an actuator: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    The limit bounds the drive's whole law for every motion of the joint with |α| <= max_acceleration, until a next
    frame that is one period late. If the law exceeds the limit, the commanded torque is sent as feed-forward, with the
    gains that the limit permits; with feedback older than two ticks, only torque_command is sent.
    cext/kernels/devices/drive_law.pxd describes the rule. **For a hard bound, command torque only.**

    A family defines `find`, which returns a model by its name, and the native encode and decode. It may change the
    defaults.
    """

    model = Param("", "1", "model in the vendor's spelling", required=True, dtype=str)
    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    can_id = Param(1, "1", "CAN id set in the drive", min=1, max=255, fixed=True)
    limit = Param(
        "rated",
        "N·m",
        "largest torque command at the joint: rated, peak, or a number up to the peak torque",
        dtype=object,
    )
    invert = Param(False, "1", "whether the joint turns opposite to the motor", fixed=True)
    offset = Param(
        0.0,
        "rad",
        "motor position at the zero of the joint, in the units and direction of the joint",
        min=-12.5,
        max=12.5,
        fixed=True,
    )
    range = Param(
        (), "rad", "(lowest, highest) angle of the joint's mechanical range; beyond it the run ends. () if unknown"
    )
    wake_shift = Param(
        None,
        "rad",
        "angle by a multiple of which a power cycle can shift the reading of the joint; the model's by default, 0 if "
        "this unit was verified to keep its reading",
        dtype=float,
        min=0.0,
        fixed=True,
        kernel=False,
    )
    known_pose = Param(
        (), "rad", "(angle, tolerance) of the pose in which the operator holds the joint during arming; () for none"
    )
    reference = Param(
        "",
        "1",
        "output of another device that measures the same angle, such as 'left/encoder.angle', compared during arming",
        dtype=str,
    )
    timeout = Param(
        0.1, "s", "time without a reply after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True
    )
    safe_stop = Param(
        "disable",
        "1",
        "safe stop: disable, or damp first if a free joint would let the wearer fall",
        choices=("disable", "damp"),
    )
    rms_mode = Param(
        "saturate",
        "1",
        "action when the RMS torque exceeds the rated torque",
        choices=("silent", "warn", "saturate", "throttle", "disable"),
    )
    rms_window = Param(20.0, "s", "window of the RMS torque", above=0.0, max=3600.0, fixed=True, kernel=False)
    warning_temperature = Param(
        70.0, "°C", "temperature above which the drive is reported as warm", fixed=True, kernel=False
    )
    derating_temperature = Param(
        80.0, "°C", "temperature above which the torque limit decreases", fixed=True, kernel=False
    )
    fault_temperature = Param(
        100.0, "°C", "temperature at which the torque limit is zero and the run ends", fixed=True, kernel=False
    )
    stop_damping = Param(
        1.0,
        "N·m·s/rad",
        "damping in the safe stop; reduced if the joint moves too fast for the torque limit",
        above=0.0,
        fixed=True,
        kernel=False,
    )
    stop_time = Param(
        1.0, "s", "duration of the damping in the safe stop", above=0.0, max=5.0, fixed=True, kernel=False
    )
    gear_ratio = Ranges.gear_ratio
    wire_position, wire_velocity, wire_stiffness = Ranges.wire_position, Ranges.wire_velocity, Ranges.wire_stiffness
    wire_damping, wire_torque, at_joint = Ranges.wire_damping, Ranges.wire_torque, Ranges.at_joint
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

    max_velocity = Param(
        0.0,
        "rad/s",
        "joint speed above which the run ends; 0: the model's no-load speed if published, else the end of the encoded "
        "range",
        min=0.0,
        fixed=True,
        kernel=False,
    )

    zero_at_arming = Param(
        False,
        "1",
        "whether arming makes the present position the drive's zero; the joint then reads -offset",
        fixed=True,
        kernel=False,
    )

    disabled = Param(
        False,
        "1",
        "whether the drive is taken out of the run; false arms it again, and its commands fade in",
        min=0,
        max=1,
        live=True,
        kernel=False,
    )

    position_command = Input("rad", "equilibrium angle θ₀", default=0.0)
    velocity_command = Input("rad/s", "reference velocity ω₀", default=0.0)
    torque_command = Input("N·m", "feed-forward torque τ_ff", default=0.0)
    stiffness_command = Input("N·m/rad", "stiffness K", default=0.0)
    damping_command = Input("N·m·s/rad", "damping B", default=0.0)
    zero = Input(
        "1",
        "rising edge: the present position becomes the drive's zero; refused under torque and in motion",
        default=False,
        dtype=bool,
    )
    disable = Input("1", "true takes the drive out of the run, by setting `disabled`", default=False, dtype=bool)
    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    torque = Output("N·m", "torque of the drive, from its current")
    temperature = Output("°C", "temperature of the drive")
    fault = Output("1", "error code of the drive, 0 for none", dtype=int)
    age = Output("s", "time since the command that the newest reply answers")
    rms_torque = Output("N·m", "root mean square of the torque over `rms_window`", kernel=False)
    active = Output("1", "whether its commands are sent; false while it is taken out", dtype=bool, kernel=False)
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

    hardware = (
        "can_id",
        "invert",
        "offset",
        "range",
        "wake_shift",
        "known_pose",
        "reference",
        *(f"wire_{name}" for name in RANGES),
    )
    sent_outputs: tuple[str, ...] = ("torque_sent", "limited")
    law_limit = ("limits", 5)
    velocity_codes = 0xFFF  # steps of the velocity in its feedback

    find: Any  # function of a name that returns a model
    parameters: dict[str, Param[Any]]
    hot: float | None

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

    def check_zero(self) -> None:
        """Raise ValueError if arming would set the zero of a joint to an angle outside its range."""
        low, high = self.range or (-math.inf, math.inf)
        if self.zero_at_arming and not low <= -self.offset <= high:
            raise ValueError(
                f"zero_at_arming sets the joint to -offset, {-self.offset:g} rad, which is outside its range of "
                f"{low:g} to {high:g} rad: correct offset or range"
            )

    def set_zero_frame(self) -> tuple[int, bool, bytes] | None:
        """Return the frame that makes the present position of the drive its zero, or None."""
        return None

    def zeroing(self) -> Zeroing | None:
        """Return the Zeroing of the drive, or None if its protocol has no such frame."""
        frame = self.set_zero_frame()
        return frame and Zeroing(frame, self.offset, 1.01 * self.wire[4] / 0xFFF, self.zero_at_arming)

    def check_pose(self) -> None:
        """Set `shift`, rad by which a power cycle can shift the reading of the joint, and check `known_pose`."""
        self.shift = self.spec.wake_shift / self.gear_ratio if self.wake_shift is None else self.wake_shift
        self.known_pose = pose_of(self.known_pose, self.shift)

    def check_temperatures(self) -> None:
        """Raise ValueError unless the temperature thresholds are in ascending order."""
        self.hot = self.warning_temperature
        if not self.warning_temperature <= self.derating_temperature < self.fault_temperature:
            raise ValueError(
                "warning_temperature, derating_temperature and fault_temperature must be in ascending order, got "
                f"{self.warning_temperature:g}, {self.derating_temperature:g} and {self.fault_temperature:g} °C"
            )

    def watched(self) -> Watch:
        """Return the thresholds of the drive monitor."""
        return Watch(
            rated=self.rated_torque(),
            limit=self.torque_limit,
            mode=self.rms_mode,
            window=self.rms_window,
            warm=self.warning_temperature,
            derate=self.derating_temperature,
            hot=self.fault_temperature,
            law_limit=self.law_limit,
            motion=self.motion(),
        )

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

    def motion_of_any_mode(self) -> dict[str, Any]:
        """Return the fields of `Motion` that do not depend on the mode of the drive."""
        position, velocity = self.feedback_ends()
        return {
            "range": self.range,
            "fastest": self.fastest(velocity),
            "limit": self.torque_limit,
            "accuracy": self.torque_accuracy(),
            "offset": self.offset,
            "position_code": 2.0 * self.wire[0] / 0xFFFF,
            "position_end": position,
            "velocity_end": velocity,
            "velocity_tolerance": 1e-2 * SCALE_TOLERANCE,
        }

    def feedback_ends(self) -> tuple[float, ...]:
        """Return the ends of the feedback's range at the joint, rad and rad/s."""
        return self.wire[:2]

    def fastest(self, end: float) -> float:
        """Return the overspeed limit in rad/s: below the end of the feedback's range if the speed is not published."""
        no_load = getattr(self.spec, "no_load", math.inf) * math.pi / 30.0 / self.gear_ratio
        return min(self.max_velocity or min(no_load, 0.995 * self.wire[1]), 0.995 * end)

    def torque_accuracy(self) -> float:
        """Return the accuracy of the measured torque, N·m.

        No vendor publishes it; torque constants measured by users deviate by 4 to 12 % from the published ones.
        """
        peak = self.wire[4] if self.spec.peak is None else self.spec.peak * self.gear_ratio
        return 1e-2 * TORQUE_ACCURACY * peak

    def rated_torque(self) -> float:
        """Return the rated torque at the joint, N·m; the given limit where no rating is published."""
        return self.torque_limit if self.spec.rated is None else self.spec.rated * self.gear_ratio

    def rest_torque(self, code: float) -> float:
        """Return the largest measured torque of the drive at rest, N·m. code : resolution of the measurement, N·m"""
        return 1e-3 * STOP_REST_TORQUE * self.rated_torque() + code

    def winding(self) -> Winding:
        """Return the currents of the motor at the torque limit."""
        return winding_of(self.spec, self.gear_ratio, self.torque_limit)

    def find_limit(self) -> float:
        """Return the torque limit, N·m at the joint: rated, peak or a number, within the encoded range."""
        spec, ratio = self.spec, self.gear_ratio
        if spec.rated is None:
            return self.given_limit()
        named = {"rated": spec.rated * ratio, "peak": spec.peak * ratio}
        if isinstance(self.limit, str):
            if self.limit not in named:
                raise ValueError(f"limit must be 'rated', 'peak' or a torque in N·m, got {self.limit!r}")
            return min(named[self.limit], self.wire[4])
        if isinstance(self.limit, bool) or not isinstance(self.limit, Real):
            raise ValueError(f"limit must be 'rated', 'peak' or a torque in N·m, got {self.limit!r}")
        limit = float(self.limit)
        if not 0.0 < limit <= named["peak"]:
            behind = "" if ratio == 1.0 else f" behind a gear of {ratio:g}"
            raise ValueError(
                f"limit must be above 0 and at most the peak torque of {spec.name}{behind}, {named['peak']:g} N·m, "
                f"got {limit:g} N·m"
            )
        return min(limit, self.wire[4])

    def given_limit(self) -> float:
        """Return the limit of a model without published ratings: a number within the drive's range."""
        limit = self.limit
        if isinstance(limit, (str, bool)) or not isinstance(limit, Real):
            raise ValueError(
                f"rated and peak torque of {self.spec.name} are not published: pass limit= in N·m, got {self.limit!r}"
            )
        if not 0.0 < float(limit) <= self.wire[4]:
            raise ValueError(
                f"limit must be above 0 and within the range of {self.spec.name}, {self.wire[4]:g} "
                f"N·m, got {self.limit:g}"
            )
        return float(limit)

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

    def reach(self) -> dict[str, Reach]:
        """Return the range of setpoints as graph.reach.Reach: of the drive, and of the joint if `range` is set."""
        position, name = self.wire[0] + abs(self.offset), self.spec.name
        peak = self.wire[4] if self.spec.peak is None else min(self.spec.peak * self.gear_ratio, self.wire[4])
        return {
            "position": Reach(
                Interval(-position, position), f"command range of {name}", Interval(*self.range) if self.range else None
            ),
            "velocity": Reach(Interval(-self.wire[1], self.wire[1]), f"command range of {name}"),
            "torque": Reach(Interval(-peak, peak), f"peak torque of {name}"),
        }

    def rating(self) -> str:
        """Return the source of the command limits as text."""
        source = f"{self.limit} torque" if isinstance(self.limit, str) else "its limit"
        return f"{source} and encoded ranges of {self.spec.name}"

    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound:
        """Return the bound: proved for torque only, with stiffness or damping under the assumption on acceleration."""
        stiffness, damping = commands["stiffness_command"], commands["damping_command"]
        limit = self.torque_limit
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
        return [*deviations.of_ranges(self, joint_scales(self.gear_ratio)), *deviations.of_model(self)]

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


def unit_of(block: Any) -> Any:
    """Return the model of a block with the encoded ranges of its unit, where they differ from the table."""
    own = {f"wire_{name}": getattr(block, f"wire_{name}") for name in RANGES}
    return replace(block.spec, **{name: value for name, value in own.items() if value})


def winding_of(spec: Any, gear_ratio: float, limit: float | None) -> Winding:
    """Return the Winding of a model.

    gear_ratio : ratio of the external gear; limit : N·m at the joint, None if the command does not bound the torque

    The current per torque is the largest of the published ratios, at the rated and at the peak torque: the torque of a
    motor that saturates rises less than its current.
    """
    points = ((spec.rated, spec.rated_current), (spec.peak, spec.peak_current))
    ratios = [current / torque for torque, current in points if torque and current]
    if not ratios and spec.torque_constant:
        ratios = [1.0 / spec.torque_constant]
    current = spec.peak_current
    if limit is not None:
        current = max(ratios) * limit / gear_ratio if ratios else None
    rated = None if spec.rated is None else spec.rated * gear_ratio
    supply, note = getattr(spec, "supply", ()), getattr(spec, "supply_note", "")
    return Winding(limit, current, rated, spec.rated_current, spec.peak_current, supply, note)


def pose_of(pose: Sequence[float], shift: float) -> tuple[float, ...]:
    """Return (angle, tolerance) of the parameter `known_pose`, () for none. Raises ValueError."""
    if not isinstance(pose, (tuple, list)) or len(pose) not in (0, 2):
        raise ValueError(f"known_pose must be an angle and a tolerance in rad, as in [0.0, 0.1], got {pose!r}")
    if not all(isinstance(x, Real) and not isinstance(x, bool) and math.isfinite(x) for x in pose):
        raise ValueError(f"known_pose must be an angle and a tolerance in rad, got {pose!r}")
    if pose and not (0.0 < pose[1] and (shift == 0.0 or pose[1] < shift / 2.0)):
        raise ValueError(
            f"the tolerance of known_pose must be above 0 and below {shift / 2.0:.4g} rad, half the shift of a power "
            f"cycle, got {pose[1]:g}"
        )
    return tuple(map(float, pose))


def motion_of(limits: Sequence[float], reach: float) -> tuple[float, ...]:
    """Return (lowest, highest) of the parameter `range`, () if unknown. Raises ValueError.

    reach : largest angle of the joint that the drive can report, in rad
    """
    if not isinstance(limits, (tuple, list)) or len(limits) not in (0, 2):
        raise ValueError(f"range must be the lowest and the highest angle in rad, as in [-0.1, 2.0], got {limits!r}")
    finite = all(isinstance(x, Real) and not isinstance(x, bool) and math.isfinite(x) for x in limits)
    if not finite or (limits and not limits[0] < limits[1]):
        raise ValueError(f"range must be the lowest and the highest angle in rad, in this order, got {limits!r}")
    if limits and max(-limits[0], limits[1]) > reach:
        degrees = ", ".join(f"{math.radians(x):.4g}" for x in limits)
        raise ValueError(
            f"range must be within ±{reach:.4g} rad, the positions that the drive reports, got {limits!r}: if these "
            f"are degrees, write [{degrees}]"
        )
    return tuple(map(float, limits))
