"""Frames of MIT mode that are the same for all boards. cext/kernels/mit.pxd has the layout."""

ENABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfc"
DISABLE = b"\xff\xff\xff\xff\xff\xff\xff\xfd"
SET_ZERO = b"\xff\xff\xff\xff\xff\xff\xff\xfe"
NOTHING = bytes.fromhex("7fff7ff0000007ff")         # position, velocity and torque in the middle of their ranges, no stiffness, no damping


def damped(share):
    """As NOTHING, with a share of the range of damping."""
    code = int(share * 0xFFF)
    return bytes([*NOTHING[:5], code >> 4, (code & 15) << 4 | NOTHING[6] & 15, NOTHING[7]])
