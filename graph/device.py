"""Devices: blocks that represent hardware on a bus. One block has two steps: decode feedback, encode commands."""

import math
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, TypeAlias

from graph.block import Block
from graph.diagnostics import Diagnostic, DiagramError
from graph.interval import Interval

Frame: TypeAlias = tuple[int, bool, bytes]
"""Arbitration id, whether the id is extended, data."""


@dataclass(frozen=True)
class Motion:
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
    gains: tuple | None = None
    range: tuple = ()
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


@dataclass(frozen=True)
class Watch:
    """Torque and temperature limits of an actuator during a run (cext/safety/drive_watch.pyx).

    rated, limit : rated and highest torque at the output `torque`, N·m; the RMS torque is written to `rms_torque`
    mode : reaction to an RMS torque above the rated torque: silent, warn, saturate, throttle or disable
    window : averaging time of the RMS torque, s
    warm, derate, hot : temperatures that cause a warning, a reduced torque limit, and a fault, °C
    law_limit : (name of a memory, index) from which the kernel reads the remaining torque limit, or None
    motion : Motion; with None, only NaN and infinity in the feedback are faults
    """

    rated: float
    limit: float
    mode: str = "saturate"
    window: float = 20.0
    warm: float = 70.0
    derate: float = 80.0
    hot: float = 100.0
    law_limit: tuple | None = None
    motion: Motion | None = None

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


@dataclass(frozen=True)
class ReplyField:
    """An integer field in a reply frame, most significant bit first, described without a decoder.

    The value is low + code (high - low) / (2^bits - 1). In a signed field (two's complement) the first bit is inverted
    before the conversion.

    frames : frames with this field, as (arbitration id, mask, is extended, first bytes), like `Device.replies`
    first : index of the first bit in the data; bits : number of bits
    little_endian : whether the field, of whole bytes, has its least significant byte first
    """

    frames: tuple
    first: int
    bits: int
    low: float
    high: float
    signed: bool = False
    little_endian: bool = False


@dataclass(frozen=True)
class StopReply:
    """Replies of a device in a safe stop, and what they report at rest (cext/safety/stop_confirmation.pyx).

    frames : its replies, as (arbitration id, mask, is extended, first bytes)
    unasked : frames that it also sends by itself, which differ from replies in their id; same form
    length : number of data bytes of both; 0 for any
    torque : ReplyField of its torque or current; None for a device that makes no torque
    rest : largest torque or current at rest, in the unit of `torque`
    disabled : (mask, value) of the bits of the arbitration id by which a reply reports that the device is disabled
    enabled : ReplyField whose value is 0 while the device is disabled; None without one
    echo : (index of a byte, value) in the reply to a disable; an error code may take its place. () without one
    reports : whether it may send `frames` by itself, so that their number says nothing
    """

    frames: tuple
    unasked: tuple = ()
    length: int = 0
    torque: ReplyField | None = None
    rest: float = 0.0
    disabled: tuple[int, int] = (0, 0)
    enabled: ReplyField | None = None
    echo: tuple = ()
    reports: bool = False


@dataclass(frozen=True)
class CommandReplies:
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


@dataclass(frozen=True)
class DampedStop:
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
    bands: tuple
    velocity: ReplyField | None
    acceleration: float
    round: float
    limit: float
    transit: float = 0.0


@dataclass(frozen=True)
class Zeroing:
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


@dataclass(frozen=True)
class TorqueBound:
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
    figures: tuple = ()
    setting: str = "limit"

    def limit_in_words(self) -> str:
        """Return the limit and its justification as text, "" for an unknown limit."""
        if self.kind == "none":
            return "no torque limit in this mode"
        if self.limit is None:
            return ""
        words = {"assumed": f" {self.holds}", "drive": " inside the drive, not verified"}
        return f"limit {self.limit:g} N·m{words.get(self.kind, '')}"


@dataclass(frozen=True)
class Deviation:
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


@dataclass(frozen=True)
class Winding:
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


class Device(Block):
    """A block on a bus: outputs hold the newest sample at the start of a tick, inputs are sent at its end.

    decode, encode : kernels of the types decode_t and encode_t of cext.abi
    medium : type of the bus: "can"; "stream", bytes of a serial line, a socket or an input device, in frames of up to
        64 bytes; or "i2c", one frame for each reply to a register transfer
    bus : logical name, which a rig file assigns to an interface
    timeout : time without a sample after which the run ends in the safe stop, s; 0 to disable
    relay_time : time without a command after which the relay of this device opens, s; 0 for a device without a relay.
        If it is above 0, `encode` is also called in every round of arming and while a safe stop damps, until the relay
        opens
    start_time : time at the beginning of arming during which no other device receives a frame, s, so that devices
        powered through the relay can start
    hot : temperature above which the operator should inspect the device before arming, °C; None to disable
    hardware : names of the parameters that describe construction and mounting, the only ones that a rig file may set
    """

    decode: Any = None
    encode: Any = None
    medium: str = "can"
    bus: Any = ""
    bitrate: Any = 1e6  # bit/s of its bus
    timeout: Any = 0.0
    relay_time: float = 0.0
    start_time: float = 0.0
    protects: Any = ()  # paths or buses of the devices that its relay powers
    own_timeout: float | None = None  # s without a command until the device stops by itself; None if unknown
    # name of a memory whose first number the kernel sets when the settings written during arming are confirmed; the
    # memory keeps its value when the blocks are reset at the start of the run
    ready: str | None = None
    unanswered_frames: int = 0  # number of its disable_frames without a reply
    # whether its replies contain whether it is enabled: `decode` then returns IDLE for those of a disabled drive
    reports_enabled: bool = False
    hot: float | None = None
    hardware: tuple[str, ...] = ()
    address_hint: str = "give each device on a bus its own `can_id`"
    sent_outputs: tuple[str, ...] = ()  # outputs that `encode` writes, at the end of the tick
    feedthrough: Iterable[str] | None = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        unknown = next((name for name in cls.hardware if name not in cls.parameters), None)
        if unknown is not None:
            raise TypeError(f"{cls.__name__}.hardware contains {unknown!r}, which is not a parameter of the class")

    def addresses(self) -> Sequence[tuple[Any, bool]]:
        """Return the addresses of this device, as (arbitration id, is extended) pairs, unique on its bus."""
        return []

    def displayed_addresses(self) -> Sequence[Any]:
        """Return its addresses for display: numbers or text."""
        return [identifier for identifier, _ in self.addresses()]

    def address_in_words(self, address: tuple[Any, bool]) -> str:
        """Return the text of one of its `addresses`."""
        return f"CAN id {address[0]}"

    def acceptance_filters(self) -> Sequence[tuple[int, int, bool]] | None:
        """Return the acceptance filters of `decode`, as (arbitration id, mask, is extended); None for all frames.

        A frame passes a filter if its id equals the arbitration id in the bits where the mask is 1.
        """
        return None

    def malformed_in_words(self, lengths: dict[int, int], first_byte: int) -> str:
        """Describe the frames with its id that `decode` rejected.

        lengths : {number of data bytes: number of frames}; first_byte : first data byte of the newest of these frames
        """
        return "; ".join(
            f"{frames} malformed frame{'s' * (frames != 1)} of {length} bytes" for length, frames in lengths.items()
        )

    def unready_in_words(self) -> str:
        """Return why a device that responds is not `ready`, and the remedy."""
        return "the device responds, but does not confirm the settings written during arming"

    def stop_reply(self) -> StopReply | None:
        """Return the StopReply by which it confirms a safe stop; None if it cannot, and is reported as unconfirmed.

        By default a device that makes no torque confirms with any frame that `decode` accepts; an actuator cannot.
        """
        filters = self.acceptance_filters()
        patterns = [(0, 0, False), (0, 0, True)] if filters is None else filters
        return StopReply(tuple((*pattern, b"") for pattern in patterns))

    def traffic(self) -> Sequence[tuple[int, bool]]:
        """Return the frames of one tick, commands and replies, as (data bytes, is extended) pairs."""
        return []

    def reports(self) -> Sequence[tuple[float, int, bool]]:
        """Return the frames that it sends periodically, as (frequency in Hz, data bytes, is extended)."""
        return []

    def ask_frames(self) -> Sequence[Frame]:
        """Return the frames, (arbitration id, is extended, data), to which the device replies without being enabled.

        They are sent in every round of arming until the operator has confirmed. By default those that disable it, if
        they have replies; for a device that needs no enabling, those of zero torque; otherwise none: then the state of
        the device is unknown until it is enabled.
        """
        if len(self.disable_frames()) > self.unanswered_frames:
            return self.disable_frames()
        return [] if self.enable_frames() else self.zero_frames()

    def set_up_frames(self) -> Sequence[Frame]:
        """Return the frames that write settings and read them back, and do not enable the device."""
        return []

    def read_frames(self) -> Sequence[Frame]:
        """Return the frames of `set_up_frames` that only read."""
        return []

    def enable_frames(self) -> Sequence[Frame]:
        """Return the frames that enable the device without motion. An actuator gets them only after the confirmation of
        the operator, and after its settings were read back.
        """
        return []

    def zero_frames(self) -> Sequence[Frame]:
        """Return the frames that command zero torque."""
        return []

    def disable_frames(self) -> Sequence[Frame]:
        """Return the frames that disable the device. Only arming enables it again."""
        return []

    def command_replies(self) -> CommandReplies | None:
        """Return its CommandReplies, or None; the age of a sample then begins at its arrival."""
        return None

    def watched(self) -> Watch | None:
        """Return the Watch with its limits during a run, or None."""
        return None

    def damped_stop(self) -> DampedStop | None:
        """Return the DampedStop with which a safe stop begins, or None to disable the device at once."""
        return None

    def zeroing(self) -> Zeroing | None:
        """Return the Zeroing of its drive, or None if a run cannot set the drive's zero.

        It can set the zero during arming, and on a rising edge of the input `zero`, if the block has one.
        """
        return None

    def holds_power_of(self, device: "Device") -> bool:
        """Return whether another device loses power when this one receives no more commands."""
        return False

    def emulator(self, **parameters: Any) -> Any:
        """Return the block that emulates this device, made in the plant's diagram; the caller wires it.

        Raises TypeError if the device has no emulator.
        """
        raise TypeError(f"{type(self).__name__} has no emulator")


class Actuator(Device):
    """A device that moves a joint. The compiler proves that each command stays inside its limit.

    unread_settings : settings stored in the drive that arming cannot read back, as text: nothing rests on them
    """

    unread_settings: Sequence[str] = ()

    def settings_read(self) -> int:
        """Return the number of settings that arming reads back."""
        return len(self.read_frames())

    def adopt_assigned(self) -> None:
        """Check assigned parameters as other blocks do, and report assignments to what `configure` derives from them.

        A limit that is assigned would move both the proof and the encoder.
        """
        super().adopt_assigned()
        derived = copy(self)
        derived.reconfigure()
        for name, value in plain_attributes(derived).items():
            given = getattr(self, name, value)
            if given != value and name not in self.parameters:
                raise DiagramError(
                    Diagnostic(
                        "TW010",
                        f"{name} = {given!r} was assigned, but the parameters determine it: {value!r}",
                        path=self.path,
                        where=self.location,
                        hint="set a parameter instead, such as limit",
                    )
                )

    def stop_reply(self) -> StopReply | None:
        return None

    def command_limits(self) -> dict[str, Interval]:
        """Return {input: Interval} that the command at each input must not leave."""
        return {}

    def reach(self) -> dict[str, Any]:
        """Return {output: graph.reach.Reach} with the limits of its joint, {} if they are not declared.

        A setpoint outside these limits is an error.
        """
        return {}

    def rating(self) -> str:
        """Return the source of the command limits, such as 'rated torque of the drive'."""
        return ""

    def warnings_in_words(self) -> Sequence[str]:
        """Return the text of each of the 32 bits of its output `warning`."""
        return tuple(f"warning: bit {bit}" for bit in range(32))

    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound:
        """Return the TorqueBound of its torque.

        commands : {input: Interval}; period : time between two command frames, s
        """
        return TorqueBound("proved")

    def deviations(self) -> Sequence[Deviation]:
        """Return the Deviations of its settings from the table of its model. By default it has no table."""
        return ()

    def winding(self) -> Winding:
        """Return the Winding of its motor. By default nothing is known of it."""
        return Winding()

    def fault_in_words(self, code: int) -> str:
        """Return the text of a code of its output `fault`."""
        return f"code {code}"


def plain_attributes(block: Any) -> dict[str, Any]:
    """Return the public attributes of a block that are numbers, text or tuples of them."""
    return {
        name: value
        for name, value in vars(block).items()
        if name[0] != "_" and isinstance(value, (float, int, str, tuple))
    }
