"""Frames of MIT mode common to all boards. For the layout see cext/kernels/devices/mit.pxd."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.actuators.damping import damped_stop
from graph import Param, ReplyField, StopReply

if TYPE_CHECKING:
    from graph.device_data import DampedStop

ENABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfc"
DISABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfd"
SET_ZERO = b"\xff\xff\xff\xff\xff\xff\xff\xfe"
# position, velocity and torque in the middle of their ranges, no stiffness, no damping
NOTHING = bytes.fromhex("7fff7ff0000007ff")


def damped(share: float) -> bytes:
    """Return NOTHING with a fraction of the range of damping, rounded down."""
    code = int(share * 0xFFF)
    return bytes([*NOTHING[:5], code >> 4, (code & 15) << 4 | NOTHING[6] & 15, NOTHING[7]])


def torque_field(command: tuple[int, bool, bytes], half: float) -> ReplyField:
    """Return the field of the torque in commands with the layout of MIT mode. command : one; half : N·m at the joint"""
    identifier, extended, _ = command
    return ReplyField(((identifier, 0x1FFFFFFF, extended, b""),), first=52, bits=12, low=-half, high=half)


class StopInMitMode:
    """Safe stop of a drive in MIT mode, and its bus traffic per tick."""

    can_id: Param[int]
    wire: Any  # half ranges on the wire, at the joint
    reply_frames: Any  # function that returns its replies, as the frames of a ReplyField
    rest_torque: Any
    reply: Any = 8  # bytes of a reply

    def traffic(self) -> list[tuple[int, bool]]:
        """Return the command and the reply of a tick, of 8 bytes each."""
        return [(8, False), (8, False)]

    def zero_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the frame that commands zero torque."""
        return [(self.can_id, False, NOTHING)]

    def set_zero_frame(self) -> tuple[int, bool, bytes]:
        """Return the frame that makes the present position of the drive its zero."""
        return self.can_id, False, SET_ZERO

    def disable_frames(self) -> list[tuple[int, bool, bytes]]:
        """Return the frame that leaves the MIT mode."""
        return [(self.can_id, False, DISABLE)]

    def stop_reply(self) -> StopReply:
        """Return the StopReply: a torque near zero, since MIT mode does not report whether the drive is enabled."""
        frames, half = tuple(self.reply_frames()), self.wire[4]
        torque = ReplyField(frames, first=36, bits=12, low=-half, high=half)
        return StopReply(frames, length=self.reply, torque=torque, rest=self.rest_torque(2.0 * half / 0xFFF))

    def commanded_torque(self) -> ReplyField:
        """Return the field of the torque in its commands."""
        return torque_field(self.zero_frames()[0], self.wire[4])

    def damped_stop(self) -> DampedStop | None:
        """Return the DampedStop, chosen by the velocity in the replies; None without damping."""
        velocity = ReplyField(tuple(self.reply_frames()), first=24, bits=12, low=-self.wire[1], high=self.wire[1])
        return damped_stop(self, lambda damping: [(self.can_id, False, damped(damping / self.wire[3]))], velocity)
