"""The records of the ring as bytes, as cext lays them out, and the frames of a recording with them.

A row is doubles: the tick, its lateness in s, the recorded signals. A frame and a change are structs.
"""

from struct import Struct
from typing import Any, NamedTuple

CHANGE = Struct("=q4i3d")  # struct Change of cext/ring/mailbox.pxd
FRAME = Struct("=qIBBBB64s")  # struct Frame of cext/abi.pxd
BUS_BYTE = 14  # of a frame: number of its bus
ID_MASK = 0x1FFFFFFF
ID_FLAGS = {"extended": 0x80000000, "remote": 0x40000000, "error": 0x20000000}  # of struct can_frame
FD_FLAGS = {"rate_switch": 1, "error_state": 2, "fd": 4}  # of struct canfd_frame
CLASSIC_BYTES = 8  # of data at most, without CAN FD


def row_struct(signals: int) -> Struct:
    """Return the Struct of a row. signals : number of recorded signals"""
    return Struct(f"={2 + signals}d")


def rate_ratios(plan: Any) -> list[float]:
    """Return bitrate / data bitrate of each bus: 1 without a rate switch, 0 of a bus without bitrate. plan : Plan"""
    rates: dict[str, float] = plan.get("bitrates") or {}
    fast: dict[str, float] = plan.get("data_bitrates") or {}
    return [rates[name] / (fast.get(name) or rates[name]) if name in rates else 0.0 for name in plan["buses"]]


class Frame(NamedTuple):
    """Frame of a bus.

    time : ns since the start of the run
    id : identifier without the flag bits
    bus : number of the bus
    data : bytes, 64 at most
    """

    time: int
    id: int
    extended: bool
    remote: bool
    error: bool
    fd: bool
    rate_switch: bool
    error_state: bool
    sent: bool
    bus: int
    data: bytes

    @classmethod
    def unpack(cls, payload: bytes) -> Any:
        """Return the Frame of a struct Frame."""
        time, word, length, flags, bus, sent, data = FRAME.unpack(payload)
        extended, remote, error = (bool(word & bit) for bit in ID_FLAGS.values())
        rate_switch, error_state, fd = (bool(flags & bit) for bit in FD_FLAGS.values())
        fd = fd or length > CLASSIC_BYTES
        identifier = word & ID_MASK
        return cls(
            time, identifier, extended, remote, error, fd, rate_switch, error_state, bool(sent), bus, data[:length]
        )

    def pack(self) -> bytes:
        """Return the struct Frame."""
        word = self.id | sum(bit for name, bit in ID_FLAGS.items() if getattr(self, name))
        flags = sum(bit for name, bit in FD_FLAGS.items() if getattr(self, name))
        return FRAME.pack(self.time, word, len(self.data), flags, self.bus, self.sent, self.data)

    @property
    def truths(self) -> tuple[bool, ...]:
        """Flags in the order of runtime.record.storage.messages.FRAME."""
        return self[2:9]
