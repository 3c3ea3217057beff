"""Frames of CubeMars boards as (arbitration id, is extended, data), and the words for their error codes.

Extended frames are those of V3.0 boards, and of V1 and V2 in servo mode; MIT mode is in blocks.actuators.mit_frames. An
extended identifier is (kind << 8) | id; numbers are big-endian. (AKA Series Product Manual V3.0.0, section 4; AK Series
Module Driver Manual V1.0.18.)
"""

from __future__ import annotations

import math
from typing import Any

from graph import ReplyField, StopReply

# kinds of commands
DUTY, CURRENT, BRAKE, SPEED, POSITION, ORIGIN, POSITION_SPEED, FORCE, DISABLE = 0, 1, 2, 3, 4, 5, 6, 8, 15
STATUS, POWER_UP = 0x29, 0x2C  # and of the drive's frames

DEGREES = 3276.8  # half the range of a status' position; the manual has 3200
POSITION_CODE = math.radians(0.1)  # rad, of a status
SPEED_CODE = 10.0  # electrical revolutions a minute, of a status
CURRENT_CODE = 0.01  # A, of a status
DISABLED = 0x77  # error byte of a status that answers a disable
QUIET = 0.32  # A, below which a drive that is set up is at rest

ERRORS = CODE, MASK = "code", "mask"  # meanings of the error byte in MIT mode
REPLIES = (8, 7, 6)  # bytes in MIT mode: temperature and error only in 8

FAULTS = {  # error codes of MIT mode
    0: "none",
    1: "motor too hot",
    2: "over-current",
    3: "over-voltage",
    4: "under-voltage",
    5: "encoder",
    6: "transistors too hot",
    7: "stalled",
}
# of firmware whose error byte is a mask: FAULTS where its bits are not those of a temperature
MASKED_FAULTS = FAULTS | {
    1: "bit 0, which stops the drive and which no source explains",
    4: "above 120 °C (bit 2); under-voltage if its error byte is a code",
    6: "above 120 °C (bits 1 and 2); transistors too hot if its error byte is a code",
}
WARM = "over-current; in firmware whose error byte is a mask (errors='mask'), a warning above 80 °C"
WARM_FROM = 78.0  # °C, from which on error byte 2 may be that warning
EXTENDED_FAULTS = FAULTS | {0x2C: "lost power during the run", DISABLED: "reports that it is disabled"}


def frame(kind: int, can_id: int, data: bytes = b"") -> tuple[int, bool, bytes]:
    """Return a frame with an extended id. kind : kind of the command"""
    return kind << 8 | can_id, True, bytes(data)


def amperes(kind: int, current: float, can_id: int) -> tuple[int, bool, bytes]:
    """Return the command of a current, of kind CURRENT or BRAKE."""
    return frame(kind, can_id, round(current * 1000.0).to_bytes(4, "big", signed=True))


def origin(can_id: int, permanent: bool = False) -> tuple[int, bool, bytes]:
    """Return the command that sets the zero to the present position, until power-off or permanently in flash."""
    return frame(ORIGIN, can_id, bytes([int(permanent)]))


def acceptance_filters(can_id: int) -> list[tuple[int, int, bool]]:
    """Return patterns of the frames of a drive, and of commands to it."""
    return [(STATUS << 8 | can_id, 0x1FFFF8FF, True), (can_id, 0x1FFFE0FF, True)]


def stop_reply(can_id: int, rest: float, echoes: bool) -> StopReply:
    """Return the StopReply of a board on extended frames: statuses of a current near zero.

    rest : A, largest current at rest; echoes : whether the board answers a disable
    """
    return StopReply(
        status_frames(can_id),
        length=8,
        torque=ReplyField(status_frames(can_id), first=32, bits=16, low=-327.68, high=327.67, signed=True),
        rest=rest + CURRENT_CODE,
        echo=(7, DISABLED) if echoes else (),
        reports=True,
    )


def status_frames(can_id: int) -> tuple[tuple[int, int, bool, bytes], ...]:
    """Return the status of a drive, as the frames of a ReplyField."""
    return ((STATUS << 8 | can_id, 0x1FFFFFFF, True, b""),)


def velocity_field(can_id: int, code: float) -> ReplyField:
    """Return the ReplyField of the speed in a status. code : rad/s of the joint"""
    return ReplyField(status_frames(can_id), first=16, bits=16, low=-32768 * code, high=32767 * code, signed=True)


def in_words(code: int) -> str:
    """Return the text of a fault code."""
    return EXTENDED_FAULTS.get(code, f"code {code}, not listed in the manual")


def scales(spec: Any, gear_ratio: float, torque_constant: float) -> tuple[float, float, float]:
    """Return the scales of a status at the joint: rad and rad/s per code, N·m per ampere."""
    turns = SPEED_CODE / (spec.gear * spec.pole_pairs * gear_ratio)
    return POSITION_CODE / gear_ratio, turns * math.pi / 30.0, torque_constant * gear_ratio
