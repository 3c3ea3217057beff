"""Devices at the end of a line of their own: a tty, a socket, an input of the computer. What they say is a stream of
bytes.
"""

from cext.kernels import no_io
from graph.declarations import Param
from graph.device import Device


class StreamDevice(Device):
    """A device that has a line for itself. Its `decode` is the parser: a frame holds up to 64 bytes as they came, cut
    anywhere.

    frame.id : 0 bytes; 1 the line is gone; 2 it is back
    frame.flags : bit 0, bytes before this frame were lost; bit 1, the first bytes of one read, of a datagram its
        beginning `decode` returns TAKEN where a whole sample was among them, NOTED where not, MALFORMED where what was
        among them was corrupt.

    line : kind of its line, a key of runtime.rig.streams.KINDS, whose module opens it on a rig
    opening : what that is told
    """

    bus = Param("", "1", "logical name of its line; its path by default", dtype=str)

    abstract = True
    medium = "stream"
    line = "serial"
    # of a device on a line of kind "dialogue":
    identify = None  # dialogue that returns its identity: serial, model, firmware, options, ends_with(), proof()
    sensor = "device"  # what it is, in messages
    usb_vendors = ()  # USB vendor ids of its own ports; those of serial adapters are tried, too
    remedy = ""  # which baud rates are usual, for a line that stays silent
    encode = no_io.send_nothing

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        cls.parameters = {name: param for name, param in cls.parameters.items() if name != "bus"} | {
            "bus": cls.parameters["bus"]
        }

    def configure(self):
        if not self.bus:
            self.bus = self.path

    def opening(self):
        """What a rig needs to know to open its line, by name; runtime.rig.streams.KINDS says which kind takes what."""
        return {}

    def set_up(self):
        """On a line of kind "dialogue": a dialogue (graph.dialogue) that sets an identified device up for a run.

        Returns (messages that set it up, to be sent again after a reconnect; remarks for the operator). Raises
        Rejected, NoReply, ValueError.
        """
        return [], []

    def relay_frames(self):
        """Two frames that hold its relay when they are sent in turn, for the guardian; a device with a `relay_time` has
        them.
        """
        return []

    def sends(self):
        """What it sends by itself, as (how many a second, bytes at least) pairs, where that is known."""
        return []

    def line_speed(self):
        """bit/s that its line carries, 0 where it has no baud rate, or may have none."""
        return 0.0
