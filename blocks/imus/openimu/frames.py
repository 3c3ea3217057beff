"""Frames of an OpenIMU: parameter groups of SAE J1939 that write and read its settings.

An identifier is priority << 26 | group << 8 | source address. The source address is 0xF9, that of a service tool, so
that the last byte is not the id of a drive. Settings begin with the address of their unit. (Aceinna OpenIMU300RI and
335RI, CAN messages; SAE J1939-21.)
"""

from typing import Any

OURS, EVERYBODY = 0xF9, 0xFF
REQUEST, CLAIM = 0xEA00, 0xEE00
SLOPE, ANGULAR_RATE, ACCELERATION, MAGNETIC_FIELD = 61481, 61482, 61485, 65386
SLOPE_1, FINE_RATE, FINE_ACCELERATION = 61459, 65387, 65389  # of the 335RI
PACKET_RATE, PACKET_TYPE, FILTERS, ORIENTATION, BEHAVIOUR = 65365, 65366, 65367, 65368, 65369

FASTEST = 100.0  # Hz
RATES = {FASTEST / divider: divider for divider in (1, 2, 4, 5, 10, 20, 25, 50)}
FILTER_FREQUENCIES = (0, 2, 5, 10, 25, 40, 50)  # Hz; 0 is none
SENDS_SLOPE, SENDS_RATE, SENDS_ACCELERATION, SENDS_FIELD = 1, 2, 4, 8
SENDS_FINE_RATE, SENDS_FINE_ACCELERATION, SENDS_SLOPE_1 = 8, 16, 32  # of the 335RI

RUNS_ALGORITHM, USES_FIELD, NEW_REQUEST, SWAPS_PITCH_AND_ROLL, ACCELERATION_IN_NWU = (
    0x8000,
    0x4000,
    0x0200,
    0x0008,
    0x0040,
)
STOCK = RUNS_ALGORITHM | USES_FIELD | NEW_REQUEST | SWAPS_PITCH_AND_ROLL | ACCELERATION_IN_NWU
RIGHT_HANDED = RUNS_ALGORITHM | USES_FIELD | NEW_REQUEST
MIXES = SWAPS_PITCH_AND_ROLL | ACCELERATION_IN_NWU  # puts acceleration and angular rate into different frames


def setting(group: int, *data: Any) -> tuple[int, bool, bytes]:
    """Return the frame of a setting. group : parameter group; data : bytes"""
    return 6 << 26 | group << 8 | OURS, True, bytes(data)


def request(group: int, order: Any = "little") -> tuple[int, bool, bytes]:
    """Return a request to all nodes for a parameter group. order : byte order; "big" for older firmware"""
    return 6 << 26 | (REQUEST | EVERYBODY) << 8 | OURS, True, group.to_bytes(3, order)


def behaviour(address: int, model: str) -> tuple[int, bool, bytes]:
    """Return the frame that aligns all measurements with the axes that are printed on the case."""
    if model == "335RI":  # bits to set, bits to clear, no new address
        return setting(BEHAVIOUR, address, 0, 0, MIXES & 0xFF, MIXES >> 8, 0)
    return setting(BEHAVIOUR, address, RIGHT_HANDED & 0xFF, RIGHT_HANDED >> 8)


def packet_type(address: int, types: int, model: str) -> tuple[int, bool, bytes]:
    """Return the frame that selects the packets. On a 335RI, priorities and a mask of changed ones follow: none."""
    return setting(PACKET_TYPE, address, types, 0, *((0, 0) if model == "335RI" else ()))


def packet_rate(address: int, divider: int) -> tuple[int, bool, bytes]:
    """Return the frame that sets the packet rate. divider : divider of 100 Hz, 0 for no packets"""
    return setting(PACKET_RATE, address, divider)


def filters(address: int, rate: float, acceleration: int) -> tuple[int, bool, bytes]:
    """Return the frame that sets the low-pass filters. rate, acceleration : cutoffs in Hz"""
    return setting(FILTERS, address, rate, acceleration)


def orientation(address: int, word: int) -> tuple[int, bool, bytes]:
    """Return the frame that sets the axes. word : orientation of the manual"""
    return setting(ORIENTATION, address, word >> 8, word & 0xFF)
