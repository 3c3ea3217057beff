"""Queries that several families share: the state of a drive in MIT mode, and the decoding of symmetric codes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from blocks.actuators.mit_frames import DISABLE
from graph.family import Answer

MIT_PURPOSE = "disable of drives in MIT mode"
APART = 0.02  # rad, between the positions of two drives whose reports alternate
ALTERNATIONS = 4  # fewest of them


def symmetric(code: int, half: float, bits: int) -> float:
    """Return the value of a code whose range is ± half; every vendor decodes with 2ⁿ − 1."""
    return code * 2.0 * half / ((1 << bits) - 1) - half


def disable_in_mit_mode(can_id: int) -> tuple[int, bool, bytes]:
    """Return the frame that queries a drive in MIT mode.

    A drive replies to every frame of MIT mode with its state. Of those frames, disable is the safest:

        enable (FC)     enables the drive, and with it the last command
        zero torque     eight bytes whose meaning depends on the firmware's layout and ranges: other boards read a
                        stiffness where these have a position; and a drive that was left enabled stays so
        disable (FD)    has no fields that could be misread, and leaves every drive as an uncontrolled drive should be
    """
    return can_id, False, DISABLE


def state_in_mit_mode(can_id: int, data: bytes, family: str, block: str, half: float, model: Any = None) -> Answer:
    """Return the Answer with position, velocity and torque of a reply in MIT mode; the last two need the model.

    half : rad, half the range of the position where the model is not known
    """
    answer = Answer(family, can_id, block=block)
    half = half if model is None else model.wire_position
    answer.position = symmetric(data[1] << 8 | data[2], half, 16)
    if model is not None:
        answer.velocity = symmetric(data[3] << 4 | data[4] >> 4, model.wire_velocity, 12)
        answer.torque = symmetric((data[4] & 15) << 8 | data[5], model.wire_torque, 12)
    return answer


def commanded_in_mit_mode(identifier: int, extended: bool, data: bytes) -> int | None:
    """Return the id that a frame commands in MIT mode, None for a frame that begins with the id, as replies do."""
    return None if extended or len(data) != 8 or data[0] == identifier else identifier


def same_id(count: int, can_id: int) -> str:
    """Return the remark that several drives have one id."""
    return (
        f"{count} replies to one query: {count} drives have id {can_id}. Disconnect all but one and set another id. "
        "Enable none: in MIT mode each interprets the other's replies as commands"
    )


def alternates(positions: Sequence[float]) -> bool:
    """Return whether reports of one id are of two positions, as those of two drives are. positions : rad

    A joint does not go to and fro by APART between reports, and passes through the angles between two places.
    """
    pairs = zip(positions, positions[1:], positions[2:])
    back = [abs(third - first) < 0.1 * abs(second - first) > 0.1 * APART for first, second, third in pairs]
    return len(back) >= ALTERNATIONS and (sum(back) >= 0.8 * len(back) or at_two_places(positions))


def at_two_places(positions: Sequence[float]) -> bool:
    """Return whether positions change between two places without any in between. positions : rad"""
    middle = 0.5 * (min(positions) + max(positions))
    low, high = ([each for each in positions if (each < middle) == side] for side in (True, False))
    changes = sum((before < middle) != (after < middle) for before, after in zip(positions, positions[1:]))
    if changes <= ALTERNATIONS:
        return False
    spread = max(max(high) - min(high), max(low) - min(low))
    return min(high) - max(low) > max(APART, 10.0 * spread)


def one_of(answers: Sequence[Answer], can_id: int, read_before: bool = False) -> Any:
    """Return the first of the answers of one id, as a list of one or none, with a remark where there are several.

    read_before : whether the drive had already reported before the query, so that one more frame may be such a report
    """
    if len(answers) > 1 and not read_before:
        answers[0].remarks.append(same_id(len(answers), can_id))
    return answers[:1]
