"""Frames of MIT mode that are the same for all boards. cext/kernels/devices/mit.pxd has the layout."""

from typing import Any

from blocks.actuators.damping import damped_stop
from graph import Param, ReplyField

ENABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfc"
DISABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfd"
SET_ZERO = b"\xff\xff\xff\xff\xff\xff\xff\xfe"
# position, velocity and torque in the middle of their ranges, no stiffness, no damping
NOTHING = bytes.fromhex("7fff7ff0000007ff")


def damped(share):
    """As NOTHING, with a share of the range of damping, rounded down."""
    code = int(share * 0xFFF)
    return bytes([*NOTHING[:5], code >> 4, (code & 15) << 4 | NOTHING[6] & 15, NOTHING[7]])


class StopInMitMode:
    """How a drive in MIT mode is brought to rest, and what a tick puts on its bus."""

    can_id: Param[int]
    wire: Any  # half ranges on the wire, at the joint
    replies: Any

    def traffic(self):
        return [(8, False), (8, False)]

    def zero_frames(self):
        return [(self.can_id, False, NOTHING)]

    def disable_frames(self):
        return [(self.can_id, False, DISABLE)]

    def damped_stop(self):
        velocity = ReplyField(tuple(self.replies()), first=24, bits=12, low=-self.wire[1], high=self.wire[1])
        return damped_stop(self, lambda damping: [(self.can_id, False, damped(damping / self.wire[3]))], velocity)
