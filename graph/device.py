"""Devices: blocks that represent hardware on a bus. One block has two steps: decode feedback, encode commands."""

from collections.abc import Iterable, Sequence
from copy import copy
from typing import Any

from graph.block import Block
from graph.device_data import (
    Caps,
    CommandReplies,
    DampedStop,
    Deviation,
    Frame,
    ReplyField,
    StopReply,
    TorqueBound,
    Watch,
    Winding,
    Zeroing,
)
from graph.diagnostics import Diagnostic, DiagramError
from graph.interval import Interval

UNIT_EXPECTED = 2.0  # first item of the memory `unique` of a device, from which on arming requires one unit


class Device(Block):
    """A block on a bus: outputs hold the newest sample at the start of a tick, inputs are sent at its end.

    decode, encode : kernels of the types decode_t and encode_t of cext.abi
    medium : type of the bus: "can"; "stream", bytes of a serial line, a socket or an input device, in frames of up to
        64 bytes; or "i2c" or "spi", one frame for each reply to a transfer
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
    data_bitrate: Any = 0.0  # bit/s of the data phase of CAN FD on its bus; 0: no rate switch
    timeout: Any = 0.0
    relay_time: float = 0.0
    start_time: float = 0.0
    protects: Any = ()  # paths or buses of the devices that its relay powers
    own_timeout: float | None = None  # s without a command until the device stops by itself; None if unknown
    own_timeout_declared: bool = False  # whether it is only declared: neither written nor read back
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
        if cls.step is not Block.step:
            raise TypeError(
                f"{cls.__name__} is a device, whose kernels `decode` and `encode` compute: move its step to a block "
                "that is connected to it"
            )

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

    def shifts(self) -> Sequence[tuple[float, int, int]]:
        """Return (transfers per second, bytes, frames) of each of its transfers on SPI."""
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

    def unit_memory(self, serial: str) -> dict[str, tuple[float, ...]]:
        """Return {name of a memory: values} with which every arming requires the unit with this serial number.

        {} for a device that does not report its number while it is armed. Those that do have a memory `unique`, whose
        first item is UNIT_EXPECTED or more.
        """
        return {}

    def enable_frames(self) -> Sequence[Frame]:
        """Return the frames that enable it without motion: of an actuator, after its read-back and the confirmation."""
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
    caps: Caps | None = None  # of the diagram; the compiler applies them to what the block returns, whatever it returns

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

    def commanded_torque(self) -> ReplyField | None:
        """Return the ReplyField of the torque in its command frames, in N·m at the joint; None if there is none.

        The guardian reads it. A negative `first` counts bits before the data, in the identifier as 32 bits.
        """
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

    def compared_in_words(self) -> str:
        """Return the measurements of its replies that arming compares with its parameters, "" for none."""
        return ""

    def assumptions(self) -> Sequence[tuple[str, str]]:
        """Return (number, reason) of each assumed number of its model on which its limit rests."""
        return ()

    def winding(self) -> Winding:
        """Return the Winding of its motor. By default nothing is known of it."""
        return Winding()

    def fault_in_words(self, code: int) -> str:
        """Return the text of a code of its output `fault`."""
        return f"code {code}"


def actuators_of(blocks: Iterable[Block]) -> list[Actuator]:
    """Return the actuators among blocks, such as those of a Diagram."""
    return [block for block in blocks if isinstance(block, Actuator)]


def plain_attributes(block: Block) -> dict[str, Any]:
    """Return the public attributes of a block that are numbers, text or tuples of them."""
    return {
        name: value
        for name, value in vars(block).items()
        if name[0] != "_" and isinstance(value, (float, int, str, tuple))
    }
