"""Devices with a line of their own: a tty, a socket or an input device. They send a stream of bytes."""

from collections.abc import Sequence
from typing import Any

from cext.kernels import no_io
from graph.declarations import Param
from graph.device import Device


class StreamDevice(Device):
    """A device with a line of its own. Its `decode` parses frames of up to 64 bytes of the stream, split anywhere.

    frame.id : 0 data; 1 line disconnected; 2 line reconnected
    frame.flags : bit 0, bytes before this frame were lost; bit 1, first bytes of one read, or of a datagram

    `decode` returns TAKEN for a complete sample, NOTED for an incomplete one, MALFORMED for corrupt bytes.

    line : kind of the line, a key of runtime.robot.rig.streams.KINDS
    """

    bus = Param("", "1", "logical name of the line, by default the path of the block", dtype=str)

    abstract = True
    medium = "stream"
    line = "serial"
    # of a device on a line of kind "dialogue":
    identify = None  # dialogue that returns its identity: serial, model, firmware, options, ends_with(), proof()
    sensor = "device"  # name in messages
    usb_vendors = ()  # USB vendor ids of its ports; ports of serial adapters are tried as well
    remedy = ""  # usual baud rates, shown if the device does not respond
    message_bytes = 0  # size of the messages that an emulator on a line of kind "net" sends
    on_emulated_line = False  # whether its emulator is on a line, where a run sets it up
    encode = no_io.send_nothing

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.parameters = {name: param for name, param in cls.parameters.items() if name != "bus"} | {
            "bus": cls.parameters["bus"]
        }

    def configure(self) -> None:
        if not self.bus:
            self.bus = self.path

    def opening(self) -> dict[str, Any]:
        """Return {option: value} with which runtime.robot.rig.streams opens its kind of line."""
        return {}

    def set_up(self) -> Any:
        """Set up an identified device on a line of kind "dialogue": a dialogue (graph.dialogue).

        Returns (messages to send again after a reconnect, remarks for the operator, {name: text} of the settings that
        were read back, for the recording). Raises Rejected, NoReply, ValueError.
        """
        return [], [], {}

    def relay_frames(self) -> Sequence[bytes]:
        """Return the two frames that the guardian sends alternately to keep the relay of this device closed.

        Required if `relay_time` is above 0.
        """
        return []

    def sends(self) -> Sequence[tuple[float, int]]:
        """Return the messages that it sends, as (frequency in Hz, least number of bytes) pairs, [] if unknown."""
        return []

    def line_speed(self) -> float:
        """Return the speed of its line in bit/s, 0 for a line without a baud rate."""
        return 0.0
