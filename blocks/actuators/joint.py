"""What the actuators with a driver board of their own share: one at a joint, commanded with torque, stiffness and
damping.
"""

import math
from numbers import Real
from typing import Any

from blocks.actuators import law_figures
from cext.safety.thresholds import SCALE_TOLERANCE, SCALE_TOLERANCE_WIRE_TORQUE, TORQUE_ACCURACY
from graph import Input, Interval, Memory, Motion, Output, Param, TorqueBound, Watch
from graph.reach import Reach

RANGES = ("position", "velocity", "stiffness", "damping", "torque")


class Ranges:
    """Parameters for how an actuator's motor sits at its joint, and for the ranges of its frames.

    Not inherited but taken over one by one, as parameters are also given by position.
    """

    gear_ratio = Param(
        1.0, "1", "of a gear behind the actuator: motor angle over joint angle", above=0.0, max=1000.0, fixed=True
    )
    wire_position = Param(
        0.0,
        "rad",
        "half the wire's range, where a unit's firmware differs from the table; 0 for the table's",
        min=0.0,
        fixed=True,
    )
    wire_velocity = Param(0.0, "rad/s", "half the wire's range, likewise", min=0.0, fixed=True)
    wire_stiffness = Param(0.0, "N·m/rad", "the wire's range from 0, likewise", min=0.0, fixed=True)
    wire_damping = Param(0.0, "N·m·s/rad", "the wire's range from 0, likewise", min=0.0, fixed=True)
    wire_torque = Param(0.0, "N·m", "half the wire's range, likewise", min=0.0, fixed=True)

    def at_joint(self, found):
        """The five half ranges of a model's wire, as they are at the joint: kernels then need to know nothing of the
        gear.
        """
        own = [getattr(self, f"wire_{name}") or getattr(found, f"wire_{name}") for name in RANGES]
        ratio = self.gear_ratio
        return tuple(x * scale for x, scale in zip(own, (1.0 / ratio, 1.0 / ratio, ratio**2, ratio**2, ratio)))


class Joint:
    """Ports, parameters and limits of an actuator: τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff, closed in the drive.

    The limit bounds the drive's whole law for every motion of the joint with |α| <= max_acceleration, until a next
    frame that is a period late. Where the law does not fit, the wanted torque is sent as feed-forward, with as much of
    the gains as the limit leaves; on feedback older than two ticks, torque_command alone.
    cext/kernels/devices/drive_law.pxd has the rule. **Where a bound must be hard, command torque alone.**

    A family gives `find`, which looks a model up by its name, and the native encode and decode. It may change the
    defaults.
    """

    model = Param("", "1", "as the vendor writes it", required=True, dtype=str)
    bus = Param("can", "1", "logical name of its CAN bus", dtype=str)
    can_id = Param(1, "1", "id set in the drive", min=1, max=255, fixed=True)
    limit = Param(
        "rated",
        "N·m",
        "largest torque command at the joint: rated, peak, or a number up to the peak torque",
        dtype=object,
    )
    invert = Param(False, "1", "whether the joint turns against the motor", fixed=True)
    offset = Param(
        0.0,
        "rad",
        "motor position where the joint is at zero, at the joint and the way the joint turns",
        min=-12.5,
        max=12.5,
        fixed=True,
    )
    range = Param(
        (),
        "rad",
        "(lowest, highest) angle that the joint's own motion reaches; beyond it the run ends. () where it is not known",
    )
    wake_shift = Param(
        None,
        "rad",
        "by a multiple of which a power cycle can shift the reading of the joint; the model's by "
        "default, 0 where this unit was "
        "verified to keep it",
        dtype=float,
        min=0.0,
        fixed=True,
        kernel=False,
    )
    known_pose = Param(
        (), "rad", "(angle, tolerance) at which the operator holds the joint while the robot is armed; () for none"
    )
    reference = Param(
        "",
        "1",
        "output of another device that measures the same angle, as in 'left/encoder.angle', for the arming "
        "to compare with",
        dtype=str,
    )
    timeout = Param(0.1, "s", "silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True)
    safe_stop = Param(
        "disable",
        "1",
        "how a safe stop treats it: disable, or damp first, where a free joint would drop its wearer",
        choices=("disable", "damp"),
    )
    rms_mode = Param(
        "saturate",
        "1",
        "what happens where its RMS torque passes the rated one",
        choices=("silent", "warn", "saturate", "throttle", "disable"),
    )
    rms_window = Param(20.0, "s", "of the RMS torque", above=0.0, max=3600.0, fixed=True, kernel=False)
    warning_temperature = Param(70.0, "°C", "above which the drive is reported as warm", fixed=True, kernel=False)
    derating_temperature = Param(
        80.0, "°C", "temperature above which the torque limit decreases", fixed=True, kernel=False
    )
    fault_temperature = Param(
        100.0, "°C", "at which nothing is left of its limit, and the run ends", fixed=True, kernel=False
    )
    stop_damping = Param(
        1.0,
        "N·m·s/rad",
        "damping of the joint in the safe stop; less where it moves too fast for the limit",
        above=0.0,
        fixed=True,
        kernel=False,
    )
    stop_time = Param(
        1.0, "s", "for which it is damped before it is disabled", above=0.0, max=5.0, fixed=True, kernel=False
    )
    gear_ratio = Ranges.gear_ratio
    wire_position, wire_velocity, wire_stiffness = Ranges.wire_position, Ranges.wire_velocity, Ranges.wire_stiffness
    wire_damping, wire_torque, at_joint = Ranges.wire_damping, Ranges.wire_torque, Ranges.at_joint
    max_acceleration = Param(
        500.0,
        "rad/s²",
        "largest acceleration of the joint for which the limit holds where the drive adds stiffness or damping",
        above=0.0,
        max=1e5,
        fixed=True,
    )

    max_velocity = Param(
        0.0,
        "rad/s",
        "speed of the joint beyond which the run ends; 0: that of the model without load where its "
        "table has it, else the "
        "end of the wire's range",
        min=0.0,
        fixed=True,
        kernel=False,
    )

    position_command = Input("rad", "θ₀", default=0.0)
    velocity_command = Input("rad/s", "ω₀", default=0.0)
    torque_command = Input("N·m", "τ_ff", default=0.0)
    stiffness_command = Input("N·m/rad", "K", default=0.0)
    damping_command = Input("N·m·s/rad", "B", default=0.0)
    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    torque = Output("N·m", "of the drive, from its current")
    temperature = Output("°C", "of the drive")
    fault = Output("1", "the drive's error code, 0 for none", dtype=int)
    age = Output("s", "time since the newest reply")
    rms_torque = Output("N·m", "root mean square of its torque over rms_window", kernel=False)
    torque_sent = Output("N·m", "feed-forward torque of the frame, after limits, fade-in and quantisation")
    limited = Output(
        "1", "ticks in which another law than the commanded one was sent, to keep it inside the limit", dtype=int
    )
    wire = Memory(0.0, "half ranges on the wire, at the joint: position, velocity, stiffness, damping, torque")
    limits: Memory = Memory(
        0.0,
        "of the commands, in the same order, of the drive's whole law, and the share of stiffness and damping allowed",
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
    felt = ("limits", 5)
    velocity_codes = 0xFFF  # steps of the velocity in its feedback

    find: Any  # model of a name
    parameters: dict[str, Param[Any]]

    def configure(self):
        found = self.found = self.find(self.model)
        self.model = found.name
        self.wire = self.at_joint(found)
        self.torque_limit = self.find_limit()
        # The joint's range is the wire's, moved by the offset: what lies beyond cannot be sent.
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
        self.range = motion_of(self.range)
        self.check_pose()

    def check_pose(self):
        """Set `shift`, rad by which a power cycle can shift the reading of the joint, and check `known_pose`."""
        self.shift = self.found.wake_shift / self.gear_ratio if self.wake_shift is None else self.wake_shift
        self.known_pose = pose_of(self.known_pose, self.shift)

    def check_temperatures(self):
        self.hot = self.warning_temperature
        if not self.warning_temperature <= self.derating_temperature < self.fault_temperature:
            raise ValueError(
                "warning_temperature, derating_temperature and fault_temperature come in this order, got "
                f"{self.warning_temperature:g}, "
                f"{self.derating_temperature:g} and {self.fault_temperature:g} °C"
            )

    def watched(self):
        return Watch(
            rated=self.rated_torque(),
            limit=self.torque_limit,
            mode=self.rms_mode,
            window=self.rms_window,
            warm=self.warning_temperature,
            derate=self.derating_temperature,
            hot=self.fault_temperature,
            felt=self.felt,
            motion=self.motion(),
        )

    def motion(self):
        """What the run watches of its motion, where it is commanded with torque, stiffness and damping."""
        return Motion(
            acceleration=self.max_acceleration,
            velocity_code=2.0 * self.wire[1] / self.velocity_codes,
            gains=("limits", 6),
            law="sent",
            torque_tolerance=1e-2 * SCALE_TOLERANCE_WIRE_TORQUE,
            **self.motion_of_any_mode(),
        )

    def motion_of_any_mode(self):
        position, velocity = self.feedback_ends()
        return {
            "range": self.range,
            "fastest": self.fastest(velocity),
            "limit": self.torque_limit,
            "accuracy": self.torque_accuracy(),
            "offset": self.offset,
            "position_end": position,
            "velocity_end": velocity,
            "velocity_tolerance": 1e-2 * SCALE_TOLERANCE,
        }

    def feedback_ends(self):
        """rad and rad/s at the joint, as far as its feedback reaches."""
        return self.wire[:2]

    def fastest(self, end):
        """rad/s beyond which it is an overspeed: short of the end of what the drive reports, where the speed is not
        known.
        """
        no_load = getattr(self.found, "no_load", math.inf) * math.pi / 30.0 / self.gear_ratio
        return min(self.max_velocity or min(no_load, 0.995 * self.wire[1]), 0.995 * end)

    def torque_accuracy(self):
        """Return the accuracy of the measured torque, N·m. No vendor publishes it: torque constants that users have
        measured are 4 to 12 % off those of the stores.
        """
        peak = self.wire[4] if self.found.peak is None else self.found.peak * self.gear_ratio
        return 1e-2 * TORQUE_ACCURACY * peak

    def rated_torque(self):
        """Return the rated torque at the joint, N·m; the given limit where no rating is published."""
        return self.torque_limit if self.found.rated is None else self.found.rated * self.gear_ratio

    def find_limit(self):
        """N·m at the joint: rated or peak torque, never beyond the wire."""
        found, ratio = self.found, self.gear_ratio
        if found.rated is None:
            return self.given_limit()
        named = {"rated": found.rated * ratio, "peak": found.peak * ratio}
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
                f"limit must be above 0 and at most the peak torque of {found.name}{behind}, {named['peak']:g} N·m, "
                f"got {limit:g} N·m"
            )
        return min(limit, self.wire[4])

    def given_limit(self):
        """Return the limit of a model without published ratings: a number within the drive's range."""
        limit = self.limit
        if isinstance(limit, (str, bool)) or not isinstance(limit, Real):
            raise ValueError(
                f"rated and peak torque of {self.found.name} are not published: give limit= in N·m, got {self.limit!r}"
            )
        if not 0.0 < float(limit) <= self.wire[4]:
            raise ValueError(
                f"limit must be above 0 and within the range of {self.found.name}, {self.wire[4]:g} "
                f"N·m, got {self.limit:g}"
            )
        return float(limit)

    def command_limits(self):
        position, velocity, stiffness, damping, torque = self.limits[:5]
        return {
            "torque_command": Interval(-torque, torque),
            "position_command": Interval(-position, position),
            "velocity_command": Interval(-velocity, velocity),
            "stiffness_command": Interval(0.0, stiffness),
            "damping_command": Interval(0.0, damping),
        }

    def reach(self):
        """Angle, velocity and torque that setpoints may ask for, as graph.reach.Reach: of the drive, and of the joint
        where `range` is given.
        """
        position, name = self.wire[0] + abs(self.offset), self.found.name
        peak = self.wire[4] if self.found.peak is None else min(self.found.peak * self.gear_ratio, self.wire[4])
        return {
            "position": Reach(
                Interval(-position, position),
                f"what {name} can be commanded",
                Interval(*self.range) if self.range else None,
            ),
            "velocity": Reach(Interval(-self.wire[1], self.wire[1]), f"what {name} can be commanded"),
            "torque": Reach(Interval(-peak, peak), f"peak torque of {name}"),
        }

    def rating(self):
        source = f"{self.limit} torque" if isinstance(self.limit, str) else "its limit"
        return f"{source} and wire ranges of {self.found.name}"

    def torque_bound(self, commands, period):
        """Proved for torque alone. Stiffness and damping rest on the assumption about acceleration."""
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
        )
        return TorqueBound(
            "assumed", limit, f"while |α| <= {self.max_acceleration:g} rad/s²", self.max_acceleration, law.figures()
        )

    def output_range(self, **commands):
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


def pose_of(pose, shift):
    """(angle, tolerance) of the parameter `known_pose`, () where there is none. ValueError"""
    if not isinstance(pose, (tuple, list)) or len(pose) not in (0, 2):
        raise ValueError(f"known_pose is an angle and a tolerance in rad, as in [0.0, 0.1], got {pose!r}")
    if not all(isinstance(x, Real) and not isinstance(x, bool) and math.isfinite(x) for x in pose):
        raise ValueError(f"known_pose is an angle and a tolerance in rad, got {pose!r}")
    if pose and not (0.0 < pose[1] and (shift == 0.0 or pose[1] < shift / 2.0)):
        raise ValueError(
            f"the tolerance of known_pose must be above 0 and below {shift / 2.0:.4g} rad, half of what a power "
            f"cycle can shift, got {pose[1]:g}"
        )
    return tuple(map(float, pose))


def motion_of(limits):
    """(lowest, highest) of the parameter `range`, () where it is not known. ValueError"""
    if not isinstance(limits, (tuple, list)) or len(limits) not in (0, 2):
        raise ValueError(f"range is the lowest and the highest angle in rad, as in [-0.1, 2.0], got {limits!r}")
    finite = all(isinstance(x, Real) and not isinstance(x, bool) and math.isfinite(x) for x in limits)
    if not finite or (limits and not limits[0] < limits[1]):
        raise ValueError(f"range is the lowest and the highest angle in rad, in this order, got {limits!r}")
    return tuple(map(float, limits))
