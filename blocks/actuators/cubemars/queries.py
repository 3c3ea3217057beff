"""Queries of the state of a CubeMars drive, in MIT mode and on extended frames.

(AK Series Module Driver Manual V1.0.18, pages 64 to 68; AKA Series Product Manual V3.0.0, section 4.)
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from blocks.actuators.cubemars import frames
from blocks.actuators.cubemars.frames import FAULTS, REPLIES, WARM, WARM_FROM
from blocks.actuators.cubemars.models import POSITION
from blocks.actuators.mit_frames import DISABLE
from blocks.actuators.queries import alternates, one_of, same_id, state_in_mit_mode
from graph.family import Answer

if TYPE_CHECKING:
    from blocks.actuators.cubemars.models import Model, Motor

MIT, SERVO = "CubeMars in MIT mode", "CubeMars in servo mode, or a V3.0 board"
V3 = "CubeMars with a V3.0 board"
V3_PURPOSE = "disable of V3.0 boards"
LAST_KIND = 8  # of the commands in servo mode, force control of V3.0 boards
NO_ID = 0xFE  # not the id of a drive: identifiers that end so are replies of other vendors' drives


def state(identifier: int, extended: bool, data: bytes, can_id: int, model: Model | None = None) -> Answer | None:
    """Return the Answer of a frame of MIT mode, None for another frame.

    model : entry of blocks.actuators.cubemars.models; without it velocity and torque are None
    """
    answers = not extended and identifier in (0, can_id) and len(data) in REPLIES
    if not answers or data[0] != can_id or bytes(data) == DISABLE:
        return None
    answer = state_in_mit_mode(can_id, data, MIT, "CubeMars", POSITION, model)
    if len(data) == 8:
        answer.temperature = data[6] - 40.0
        answer.fault = FAULTS.get(data[7], f"code {data[7]}, which the manual does not list") if data[7] else ""
        if data[7] == 2 and answer.temperature > WARM_FROM:
            answer.fault = WARM
    else:
        answer.fault = None
        answer.notes.append(
            f"replies of {len(data)} bytes, without temperature and error: its block needs reply={len(data)}"
        )
        answer.settings["reply"] = len(data)
    return answer


def states(
    received: Sequence[tuple[int, bool, bytes]], can_ids: Sequence[int], before: Sequence[tuple[int, bool, bytes]]
) -> list[Answer]:
    """Return the Answers to the query of MIT mode, one for each id."""
    drives: list[Answer] = []
    for can_id in can_ids:
        answers = [answer for frame in received if (answer := state(*frame, can_id=can_id)) is not None]
        drives += one_of(answers, can_id, any(state(*frame, can_id=can_id) for frame in before))
        named = {name for frame in received if (name := other_id(*frame, can_id=can_id)) is not None}
        if named and not answers:
            remark = (
                f"replies with id {' and '.join(map(str, sorted(named)))} in byte 0: the drive is configured to answer "
                "with another id, and no block reads it"
            )
            drives.append(Answer(MIT, can_id, fault=None, remarks=[remark], block="CubeMars"))
    return drives


def other_id(identifier: int, extended: bool, data: bytes, can_id: int) -> Any:
    """Return the id in byte 0 of a reply from `can_id` that names another one, None for another frame."""
    if extended or identifier != can_id or len(data) not in REPLIES or data[0] == can_id or bytes(data) == DISABLE:
        return None
    return data[0]


def disable_v3(can_id: int) -> tuple[int, bool, bytes]:
    """Return the disable of V3.0 boards, an empty frame: V1 and V2 have none, a RobStride interprets it as `get id`."""
    return frames.frame(frames.DISABLE, can_id)


def status(identifier: int, extended: bool, data: bytes, model: Any = None) -> Answer | None:
    """Return the Answer of a report in servo mode or of a V3.0 board, None for another frame.

    model : entry of blocks.actuators.cubemars.models or models_v3; without it velocity is
        None, and torque, which is computed from the current
    """
    if not extended or identifier >> 8 != frames.STATUS or len(data) != 8:
        return None
    position, speed, current, temperature, error = struct.unpack(">hhhbB", data)
    answer = Answer(
        SERVO,
        identifier & 0xFF,
        position=position * frames.POSITION_CODE,
        current=current * 0.01,
        temperature=float(temperature),
        block="CubeMarsServo",
    )
    if model is not None:
        _, rate, torque = frames.scales(model, 1.0, model.torque_constant)
        answer.velocity, answer.torque = speed * rate, current * 0.01 * torque
    if error == frames.DISABLED:
        answer.family, answer.block = V3, "CubeMarsV3"
    else:
        answer.fault = frames.in_words(error) if error else ""
        answer.notes.append(
            "its blocks are CubeMarsServo and, with a V3.0 board, CubeMarsV3; CubeMars needs MIT mode, set with the "
            "vendor's tool"
        )
    return answer


def status_of(can_id: int, model: Motor | None = None) -> Callable[..., Any]:
    """Return a reader of the reports of one drive."""

    def read(identifier: int, extended: bool, data: bytes) -> Answer | None:
        answer = status(identifier, extended, data, model)
        return answer if answer is not None and answer.can_id == can_id else None

    return read


def reports(received: Sequence[tuple[int, bool, bytes]]) -> dict[int, Answer]:
    """Return {id: newest Answer} of drives that report: that of a V3.0 board to a disable before any other."""
    newest: dict[int, Answer] = {}
    for frame in received:
        answer = status(*frame)
        if answer is not None and answer.can_id != NO_ID and getattr(newest.get(answer.can_id), "family", "") != V3:
            newest[answer.can_id] = answer
    return newest


def all_reports(
    received: Sequence[tuple[int, bool, bytes]], can_ids: Sequence[int], before: Sequence[tuple[int, bool, bytes]]
) -> list[Answer]:
    """Return the Answers to the query of V3.0 boards: drives that report, and boards that were queried."""
    reported, queried = reports(before), reports(received)
    for can_id, answer in queried.items():
        replies = sum(status_of(can_id)(*frame) is not None for frame in received)
        if can_id not in reported and answer.family == V3 and replies > 1:
            answer.remarks.append(same_id(replies, can_id))
    for can_id, answer in (reported | queried).items():
        states = [state for frame in [*before, *received] if (state := status_of(can_id)(*frame)) is not None]
        if not answer.remarks and alternates([state.position or 0.0 for state in states]):
            answer.remarks.append(
                f"its reports alternate between two positions: 2 drives have id {can_id}. Disconnect all but one and "
                "set another id"
            )
    return list((reported | queried).values())


def commanded(identifier: int, extended: bool, data: bytes) -> int | None:
    """Return the id that another controller's frame in servo mode or force control commands, or None."""
    return identifier & 0xFF if extended and identifier >> 8 <= LAST_KIND and identifier & 0xFF != NO_ID else None
