"""Devices: blocks that stand for something at the end of a bus. One block, two steps: feedback in, command out."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from graph.block import Block
from graph.interval import Interval

Frame: TypeAlias = tuple[int, bool, bytes]
"""Arbitration id, whether it is extended, data."""


@dataclass(frozen=True)
class Motion:
    """What the run watches of an actuator's motion and torque, at the joint: cext/safety/motion_watch.pxd has the
    rules.

    acceleration : rad/s² on which the limit rests where stiffness or damping is commanded; velocity_code : rad/s of a
        code of the velocity
    gains : (name of a memory, index) where its kernel finds the share of stiffness and damping that is allowed, or None
    range : (lowest, highest) angle in rad, () where it is not known; fastest : rad/s
    limit, accuracy : N·m, of what may be measured: the first goes down with `felt`
    offset, position_end, velocity_end : rad, rad, rad/s: half ranges of what is reported, as the drive has it
    law : name of the memory of position, velocity, stiffness, damping, torque that were sent, or None
    current, current_scale : name of the output of a current that was sent, or None, and N·m of an A
    velocity_tolerance, torque_tolerance : by how much of the other two measurements of one thing may differ
    """

    acceleration: float = math.inf
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
    """What the run watches over an actuator: cext/safety/drive_watch.pyx has the rules.

    rated, limit : N·m, of what its output `torque` tells; `rms_torque` is written
    mode : what happens where the RMS torque passes the rated one: silent, warn, saturate, throttle or disable
    window : s, of the RMS torque
    warm, derate, hot : °C: told from, derated from, too hot from
    felt : (name of a memory, index) where its kernel finds what is left of its limit, or None
    motion : Motion, or None: then only what is no number is a fault
    """

    rated: float
    limit: float
    mode: str = "saturate"
    window: float = 20.0
    warm: float = 70.0
    derate: float = 80.0
    hot: float = 100.0
    felt: tuple | None = None
    motion: Motion | None = None

    def words(self) -> tuple[str, ...]:
        """What is told, in the order of cext/safety/drive_watch.pxd."""
        rms = f"RMS torque over {self.window:g} s"
        return (
            {
                "saturate": f"{rms} is above 90 % of the rated {self.rated:.3g} N·m: its limit goes down to that",
                "throttle": f"{rms} is above 90 % of the rated {self.rated:.3g} N·m: its limit goes down, to nothing "
                "at "
                "110 %",
            }.get(self.mode, f"{rms} is above the rated {self.rated:.3g} N·m"),
            f"warmer than {self.warm:g} °C",
            f"hotter than {self.derate:g} °C: its limit goes down, and at {self.hot:g} °C the run ends",
            ""
            if self.motion is None
            else (
                f"accelerates beyond its max_acceleration of {self.motion.acceleration:g} rad/s²: stiffness and "
                "damping are zero until it is calm"
            ),
        )


@dataclass(frozen=True)
class ReplyField:
    """A number in a reply, described for a reader that has no decoder of the device: an integer, most significant bit
    first.

    The value is low + code (high - low) / (2^bits - 1). In a signed field (two's complement) the first bit is inverted
    before that.

    frames : frames that carry it, as (arbitration id, mask, is extended, first bytes), like `Device.replies`
    first : the bit of the data at which it begins
    """

    frames: tuple
    first: int
    bits: int
    low: float
    high: float
    signed: bool = False


@dataclass(frozen=True)
class DampedStop:
    """Frames that take the speed out of a joint at the beginning of a safe stop. cext/safety/speed_bands.pyx chooses
    among them.

    duration : s; after it the device is disabled
    bands : (highest speed in rad/s, frames) in ascending order; the last speed is infinite. Frames are as in
        `Device.zero_frames`
    velocity : ReplyField of the joint's velocity; with None the last band is used
    acceleration : rad/s², highest of the joint: by it the speed can have grown until the next frame arrives
    round : s between frames
    limit : N·m inside which the torque stays
    """

    duration: float
    bands: tuple
    velocity: ReplyField | None
    acceleration: float
    round: float
    limit: float


@dataclass(frozen=True)
class TorqueBound:
    """What bounds the torque of an actuator.

    kind : "proved", by the bounds of its commands alone; "assumed", while an assumption holds; "drive", by a limit
        inside the drive that nothing here verifies; "none", by nothing that is sent
    limit : N·m, or None
    holds : where the kind is not "proved": in words, on what it rests
    acceleration : rad/s² that is assumed, or None
    figures : what follows from the assumption, as (name, value, unit, description)
    """

    kind: str
    limit: float | None = None
    holds: str = ""
    acceleration: float | None = None
    figures: tuple = ()


class Device(Block):
    """A block on a bus. Its outputs hold the newest sample and are there at the start of the tick; its inputs go out at
    the end.

    decode, encode : native, cext.abi's decode_t and encode_t
    medium : what its bus is: "can"; "stream", bytes as they come off a line, a socket or an input of the computer, in
        chunks of up to 64 a frame; or "i2c", a frame for each answer to a transfer of registers
    bus : logical name; a rig says which interface stands behind it
    timeout : s of silence after which the run ends in the safe stop; 0 for never
    relay_time : s without a frame of its own after which the relay that this device holds drops; 0 for a device without
        a relay. Above 0 `encode` is also called in every round of arming, and in the damped part of a safe stop as long
        as the relay cannot have dropped
    start_time : s at the beginning of arming in which no other device is sent anything: those behind the relay start
        meanwhile
    hot : °C from which on a person should look at it before it is armed; None for never
    hardware : names of the parameters that say how this one is built and mounted; a rig may set them, and no others
    """

    decode: Any = None
    encode: Any = None
    medium: str = "can"
    bus: Any = ""
    bitrate: Any = 1e6  # bit/s of its bus
    timeout: Any = 0.0
    relay_time: float = 0.0
    start_time: float = 0.0
    protects: Any = ()  # paths or buses of the devices whose power its relay switches
    own_timeout: float | None = None  # s without a command after which the device stops by itself; None if unknown
    # name of a memory whose first number its kernel sets once it has read back what arming wrote; it outlives the start
    ready: str | None = None
    unanswered_frames: int = 0  # how many of its disable_frames have no answer
    hot: float | None = None
    hardware: tuple[str, ...] = ()
    address_hint: str = "give each device on a bus its own `can_id`"
    sent_outputs: tuple[str, ...] = ()  # outputs that `encode` writes: known at the end of the tick
    feedthrough: Iterable[str] | None = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        stranger = next((name for name in cls.hardware if name not in cls.parameters), None)
        if stranger is not None:
            raise TypeError(f"{cls.__name__}.hardware names {stranger!r}, which is no parameter of it")

    def addresses(self) -> Sequence[tuple[Any, bool]]:
        """What this device answers to on its bus, as (arbitration id, is extended) pairs: no two devices may share
        one.
        """
        return []

    def told_addresses(self) -> Sequence[Any]:
        """Where it is on its bus, for people: numbers or words."""
        return [identifier for identifier, _ in self.addresses()]

    def address_in_words(self, address: tuple[Any, bool]) -> str:
        """One of its `addresses`."""
        return f"CAN id {address[0]}"

    def hears(self) -> Sequence[tuple[int, int, bool]] | None:
        """Which frames of its bus `decode` may take, as (arbitration id, mask, is extended): they agree with the id
        where the mask is 1.

        None: any frame. Others need not reach it.
        """
        return None

    def malformed_in_words(self, lengths: dict[int, int], first_byte: int) -> str:
        """Frames of its own id that `decode` rejected, for the report. lengths : {bytes: frames}; first_byte : of the
        newest
        """
        return "; ".join(
            f"{frames} frame{'s' * (frames != 1)} of {length} bytes that it rejects"
            for length, frames in lengths.items()
        )

    def unready_in_words(self) -> str:
        """Why a device that answers is not `ready`, and the remedy."""
        return "it answers, but does not return what arming wrote"

    def replies(self) -> Sequence[tuple[int, int, bool, Any]]:
        """By which frames others know that this device has answered a safe stop, as (arbitration id, mask, is extended,
        first bytes).

        Where replies and commands share an id, the first bytes tell them apart. Where more than that tells a stop, they
        are a regular expression, which the hex digits of the data begin with.
        """
        heard = self.hears()
        return [(*pattern, b"") for pattern in ([(0, 0, False), (0, 0, True)] if heard is None else heard)]

    def traffic(self) -> Sequence[tuple[int, bool]]:
        """Frames that one tick puts on the bus, commands and replies, as (data bytes, is extended) pairs."""
        return []

    def reports(self) -> Sequence[tuple[float, int, bool]]:
        """Frames that it sends by itself, as (how many a second, data bytes, is extended)."""
        return []

    def enable_frames(self) -> Sequence[Frame]:
        """Frames, (arbitration id, is extended, data), that make the device ready without moving it."""
        return []

    def read_frames(self) -> Sequence[Frame]:
        """Those of `enable_frames` that read and change nothing."""
        return []

    def zero_frames(self) -> Sequence[Frame]:
        """Frames that command nothing: zero torque."""
        return []

    def disable_frames(self) -> Sequence[Frame]:
        """Frames that make the device passive. Enabling again takes arming."""
        return []

    def watched(self) -> Watch | None:
        """What the run watches over it: a Watch, or None."""
        return None

    def damped_stop(self) -> DampedStop | None:
        """A DampedStop where a safe stop takes the speed out of the joint before it disables the device, else None."""
        return None

    def holds_power_of(self, device: "Device") -> bool:
        """Whether another device loses its power by itself soon after the frames of this one end."""
        return False

    def emulator(self, **parameters: Any) -> Any:
        """The block that plays this device in a simulation: called inside the plant's diagram, wired by the caller."""
        raise TypeError(f"{type(self).__name__} has no emulator")


class Actuator(Device):
    """A device that moves something. Each command must lie inside its limit, provably, before anything moves."""

    def command_limits(self) -> dict[str, Interval]:
        """Interval by name of input: what each command must provably stay inside, or {}."""
        return {}

    def reach(self) -> dict[str, Any]:
        """What its joint can do, as graph.reach.Reach by name of output: what is set outside that cannot be meant. {}
        where it is not known.
        """
        return {}

    def rating(self) -> str:
        """Return where the limits come from, for the proof, as in 'rated torque of' and the model's name."""
        return ""

    def warnings_in_words(self) -> Sequence[str]:
        """Words for each of the 32 bits of its output `warning`."""
        return tuple(f"warning: bit {bit}" for bit in range(32))

    def torque_bound(self, commands: dict[str, Interval], period: float) -> TorqueBound:
        """What bounds its torque: a TorqueBound.

        commands : Interval by name of input; period : s between two frames
        """
        return TorqueBound("proved")

    def fault_in_words(self, code: int) -> str:
        """What its output `fault` says."""
        return f"code {code}"

    def limit_interval(self, limit: float) -> Interval:
        return Interval(-limit, limit)
