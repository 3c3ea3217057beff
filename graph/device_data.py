"""Descriptions of a device that the schedule passes to native code: monitors, replies, stop, bounds."""

import math
from typing import Any, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

Frame: TypeAlias = tuple[int, bool, bytes]
"""Arbitration id, whether the id is extended, data."""
Pattern: TypeAlias = tuple[int, int, bool, bytes]
"""Arbitration id, mask of its bits, whether the id is extended, first bytes of the data."""


class Motion(Struct, frozen=True):
    """Limits of an actuator's motion and torque during a run (cext/safety/motion_watch.pxd).

    acceleration : highest acceleration assumed while stiffness or damping is commanded, rad/s²
    position_code, velocity_code : resolution of the reported position and velocity, rad and rad/s
    gains : (name of a memory, index) from which the kernel reads the allowed share of stiffness and damping, or None
    range : (lowest, highest) joint angle in rad, () if not declared
    fastest : highest joint speed, rad/s
    limit : highest measured torque, N·m; decreases with the torque limit of the watch
    accuracy : accuracy of the torque measurement, N·m
    offset : offset of the drive's position, rad
    position_end, velocity_end : half of the ranges that the drive reports, rad and rad/s
    law : name of the memory with the last sent position, velocity, stiffness, damping and torque, or None
    current : name of the output with the last sent current, or None; current_scale : torque per current, N·m/A
    velocity_tolerance, torque_tolerance : largest relative difference between two measurements of one quantity
    """

    acceleration: float = math.inf
    position_code: float = 0.0
    velocity_code: float = 0.0
    gains: tuple[str, int] | None = None
    range: tuple[float, ...] = ()
    fastest: float = math.inf
    limit: float = math.inf
    accuracy: float = 0.0
    offset: float = 0.0
    position_end: float = math.inf
    velocity_end: float = math.inf
    law: str | None = None
    current: str | None = None
    current_scale: float = 0.0
    velocity_tolerance: float = math.inf
    torque_tolerance: float = math.inf


class Watch(Struct, frozen=True):
    """Torque and temperature limits of an actuator during a run (cext/safety/drive_watch.pyx).

    rated, limit : rated and highest torque at the output `torque`, N·m; the RMS torque is written to `rms_torque`
    mode : reaction to an RMS torque above the rated torque: silent, warn, saturate, throttle or disable
    window : averaging time of the RMS torque, s
    warm, derate, hot : temperatures that cause a warning, a reduced torque limit, and a fault, °C
    law_limit : (name of a memory, index) from which the kernel reads the remaining torque limit, or None
    motion : Motion; with None, only NaN and infinity in the feedback are faults
    power : W, largest product of the remaining torque limit and the measured speed
    """

    rated: float
    limit: float
    mode: str = "saturate"
    window: float = 20.0
    warm: float = 70.0
    derate: float = 80.0
    hot: float = 100.0
    law_limit: tuple[str, int] | None = None
    motion: Motion | None = None
    power: float = math.inf

    def words(self) -> tuple[str, ...]:
        """Return the text of each warning, in the order of cext/safety/drive_watch.pxd."""
        rms = f"RMS torque over {self.window:g} s"
        return (
            {
                "saturate": f"{rms} is above 90 % of the rated {self.rated:.3g} N·m: the torque limit is reduced to "
                "the rated torque",
                "throttle": f"{rms} is above 90 % of the rated {self.rated:.3g} N·m: the torque limit is reduced, to "
                "zero at 110 %",
            }.get(self.mode, f"{rms} is above the rated {self.rated:.3g} N·m"),
            f"temperature above {self.warm:g} °C",
            f"temperature above {self.derate:g} °C: the torque limit is reduced, and the run ends at {self.hot:g} °C",
            ""
            if self.motion is None
            else (
                f"acceleration exceeds max_acceleration, {self.motion.acceleration:g} rad/s²: stiffness and damping "
                "are zero until it is below that limit"
            ),
            ""
            if self.motion is None
            else "replies arrive later than max_transit and one period after their commands: stiffness and damping are "
            "zero until none has for one to two seconds. Check adapter, load and length of the bus",
            ""
            if self.motion is None
            else f"the angle is at an end of the range that its frames can carry, {self.motion.position_end:.4g} rad, "
            "and the joint may be beyond it: declare its `range`, which ends the run there",
        )


class ReplyField(Struct, frozen=True):
    """An integer field in a reply frame, most significant bit first, described without a decoder.

    The value is low + code (high - low) / (2^bits - 1). In a signed field (two's complement) the first bit is inverted
    before the conversion.

    frames : frames with this field, as (arbitration id, mask, is extended, first bytes), like `Device.replies`
    first : index of the first bit in the data; bits : number of bits
    little_endian : whether the field, of whole bytes, has its least significant byte first
    """

    frames: tuple[Pattern, ...]
    first: int
    bits: int
    low: float
    high: float
    signed: bool = False
    little_endian: bool = False


class StopReply(Struct, frozen=True):
    """Replies of a device in a safe stop, and what they report at rest (cext/safety/stop_confirmation.pyx).

    frames : its replies, as (arbitration id, mask, is extended, first bytes)
    unasked : frames that it also sends by itself, which differ from replies in their id; same form
    length : number of data bytes of both; 0 for any
    torque : ReplyField of its torque or current; None for a device that makes no torque
    rest : largest torque or current at rest, in the unit of `torque`
    unit : N·m at the joint of one unit of `torque`
    disabled : (mask, value) of the bits of the arbitration id by which a reply reports that the device is disabled
    enabled : ReplyField whose value is above 0 only while the device is enabled; None without one
    echo : (index of a byte, value) in the reply to a disable; an error code may take its place. () without one
    reports : whether it may send `frames` by itself, so that their number says nothing
    """

    frames: tuple[Pattern, ...]
    unasked: tuple[Pattern, ...] = ()
    length: int = 0
    torque: ReplyField | None = None
    rest: float = 0.0
    disabled: tuple[int, int] = (0, 0)
    enabled: ReplyField | None = None
    echo: tuple[int, ...] = ()
    reports: bool = False
    unit: float = 1.0


class CommandReplies(Struct, frozen=True):
    """How an actuator answers commands (cext/safety/transit.pxd).

    max_transit : time from a command to its reply up to which stiffness and damping are permitted, s
    report_rate : rate of its reports if it does not answer commands, Hz; 0: it answers each frame once, in order
    restart_time : shortest silence in which a drive may restart that then obeys without an enable, s; 0 for a drive
        that must be enabled
    to_set_up : number of samples with which it answers `set_up_frames`; None: one each
    """

    max_transit: float
    report_rate: float = 0.0
    restart_time: float = 0.0
    to_set_up: int | None = None


class DampedStop(Struct, frozen=True):
    """Frames that damp a joint at the beginning of a safe stop, chosen in cext/safety/speed_bands.pyx.

    duration : duration of the damping, s; the device is disabled afterwards
    bands : (highest speed in rad/s, frames) in ascending order; the last speed is infinite. Frames are as in
        `Device.zero_frames`
    velocity : ReplyField of the joint's velocity; with None the last band is used
    acceleration : highest acceleration of the joint, rad/s²; bounds the speed at the arrival of the next frame
    round : time between frames, s
    limit : highest torque while damping, N·m
    transit : longest time from a frame to the arrival of its reply, unless it is measured, s
    """

    duration: float
    bands: tuple[tuple[float, tuple[Frame, ...]], ...]
    velocity: ReplyField | None
    acceleration: float
    round: float
    limit: float
    transit: float = 0.0


class Zeroing(Struct, frozen=True):
    """The frame that makes the present position of a drive its zero (cext/safety/zeroing.pxd).

    frame : (arbitration id, is extended, data)
    offset : position of the drive at the zero of the joint, rad
    torque_code : largest sent torque that counts as zero, N·m
    at_arming : whether arming sets the zero
    """

    frame: Frame
    offset: float = 0.0
    torque_code: float = 0.0
    at_arming: bool = False


class Caps(Struct, frozen=True):
    """Limits that the person imposes on one actuator, whatever its own: graph.Diagram.caps.

    torque : N·m at the joint; range : (lowest, highest) joint angle in rad, () for none; speed : rad/s
    power : largest magnitude of torque times measured speed, W
    source : text that names who imposes them
    """

    torque: float = math.inf
    range: tuple[float, ...] = ()
    speed: float = math.inf
    power: float = math.inf
    source: str = ""

    def share(self, limit: float) -> float:
        """Return the fraction of a torque limit in N·m that remains."""
        return min(1.0, self.torque / limit) if limit > 0.0 else 1.0

    def of_watch(self, watch: Watch) -> Watch:
        """Return a Watch within the caps. Raises ValueError if its range and that of the caps are disjoint."""
        motion = watch.motion
        if motion is not None:
            motion = replace(
                motion,
                limit=min(motion.limit, self.torque),
                fastest=min(motion.fastest, self.speed),
                range=self.of_range(motion.range),
            )
        limit, power = min(watch.limit, self.torque), min(watch.power, self.power)
        return replace(watch, limit=limit, power=power, motion=motion)

    def of_range(self, own: tuple[float, ...]) -> tuple[float, ...]:
        """Return a range of angles, () for none, within that of the caps. Raises ValueError if they are disjoint."""
        if not own or not self.range:
            return own or self.range
        low, high = max(own[0], self.range[0]), min(own[1], self.range[1])
        if not low < high:
            raise ValueError(
                f"its range {own[0]:.4g} to {own[1]:.4g} rad and that of {self.source}, {self.range[0]:.4g} to "
                f"{self.range[1]:.4g} rad, have no angle in common"
            )
        return low, high


class TorqueBound(Struct, frozen=True):
    """Bound of an actuator's torque, and its justification.

    kind : "proved", from the bounds of the commands; "assumed", under an assumption; "drive", a limit inside the drive
        that is not verified here; "none", no bound
    limit : highest torque, N·m; None without a bound
    holds : text that states the assumption, if the kind is not "proved"
    acceleration : assumed highest acceleration, rad/s², or None
    figures : consequences of the assumption, as (name, value, unit, description)
    setting : parameter that the operator accepts for a run on a rig, if the kind is "drive" or "none"
    """

    kind: str
    limit: float | None = None
    holds: str = ""
    acceleration: float | None = None
    figures: tuple[Any, ...] = ()
    setting: str = "limit"

    def limit_in_words(self) -> str:
        """Return the limit and its justification as text, "" for an unknown limit."""
        if self.kind == "none":
            return "no torque limit in this mode"
        if self.limit is None:
            return ""
        words = {"assumed": f" {self.holds}", "drive": " inside the drive, not verified"}
        return f"limit {self.limit:g} N·m{words.get(self.kind, '')}"


class Deviation(Struct, frozen=True):
    """A setting of an actuator that differs from the table of its model.

    The proof of the torque limit assumes that the setting is correct; `effect` and `factor` state what holds if the
    table is correct instead.

    parameter : its name; value, table : values of the actuator and of the table, numbers in `unit` or texts
    source : text that names the table
    effect : text
    factor : torque at the joint over the commanded torque; None if the setting does not scale the torque
    safe : whether the torque limit and the monitored range and velocity do not depend on it. On a rig, any other
        deviation must be accepted by the operator
    """

    parameter: str
    value: Any
    table: Any
    unit: str
    source: str
    effect: str
    factor: float | None = None
    safe: bool = False


class Winding(Struct, frozen=True):
    """Currents of an actuator, as amplitudes in a phase of its motor, and its supply.

    limit : torque limit at the joint, N·m; None if its command does not bound the torque
    current : highest current, A; None if unknown
    rated : rated torque at the joint, N·m; None if not published
    rated_current, peak_current : currents of the motor, A; None if not published
    supply : (lowest, highest) permitted voltage, V; () if not published
    supply_note : reason why that range is assumed, "" if it is published
    """

    limit: float | None = None
    current: float | None = None
    rated: float | None = None
    rated_current: float | None = None
    peak_current: float | None = None
    supply: tuple[float, ...] = ()
    supply_note: str = ""
