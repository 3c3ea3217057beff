"""Queries of the state of a RobStride drive or a CyberGear, and the frames that configure it.

    get id (type 0), read (type 17)     change nothing
    stop (type 4)                       answered with temperature and faults; leaves every drive as an uncontrolled
                                        drive should be

The host's id is 0xFD. Ids up to 15 are not possible: `get id` from host 0 is, bit for bit, the command of a duty cycle
to a CubeMars in servo mode.

(RobStride user manuals of 2026-04-28, section 4.1; CyberGear manual, section 4.1.)
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from blocks.actuators.queries import one_of, same_id, symmetric
from blocks.actuators.queries import state_in_mit_mode as common_state
from blocks.actuators.robstride import frames
from blocks.actuators.robstride.parameters import PARAMETERS
from graph.dialogue import Dialogue, Listen, Send, ask
from graph.family import Answer

if TYPE_CHECKING:
    from blocks.actuators.robstride.models import Model
    from blocks.actuators.robstride.parameters import Parameter

ROBSTRIDE, EITHER, MIT = "RobStride", "RobStride or CyberGear", "RobStride in its MIT protocol"
ID_PURPOSE, STOP_PURPOSE = "get id of RobStride drives", "stop of RobStride drives"
VERSION_PURPOSE = "stop and version of RobStride drives"
COMMANDS = (frames.OPERATION, frames.ENABLE, frames.WRITE)
HOST = 0xFD
ATTEMPTS, REPLY_TIMEOUT, TWIN_TIMEOUT = 2, 0.1, 0.01  # number; s for the first reply; s for that of a second drive
STOPS = 4  # attempts, of 0.1 s each: longer than a loose plug has no contact
VERSION = bytes([0x00, 0xC4])
POSITION = 12.57  # rad, half the wire range of all but the CyberGear and old firmware
SMALL = 0.5  # rad, position from which on a code shows its range to 0.1 %
RESET, CALIBRATION, RUN = range(3)
MODES = {RESET: "stopped", CALIBRATION: "calibrating", RUN: "running"}
PROTOCOLS = {"private": 0, "canopen": 1, "mit": 2}
COUNTING = bytes([1, 2, 3, 4, 5, 6, 7, 8])


def get_id(can_id: int, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return the frame that asks for the unique number of a drive."""
    return frames.frame(frames.GET_ID, host, can_id)


def read(index: int, can_id: int, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return the frame that reads a parameter. index : index of the parameter"""
    return frames.read(index, can_id, host)


def write(
    parameter: Parameter, value: float, can_id: int, is_cybergear: bool = False, host: int = HOST
) -> tuple[int, bool, bytes]:
    """parameter : entry of blocks.actuators.robstride.parameters"""
    value = int(value) if parameter.is_whole(is_cybergear) else float(value)
    data = struct.pack("<Hxx", parameter.index) + struct.pack(parameter.layout(is_cybergear), value)
    return frames.frame(frames.WRITE, host, can_id, data)


def stop(can_id: int, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return the frame that disables a drive."""
    return frames.frame(frames.STOP, host, can_id)


def version(can_id: int, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return a stop to which a RobStride replies with its firmware; for a CyberGear it is a plain stop."""
    return frames.frame(frames.STOP, host, can_id, VERSION.ljust(8, b"\0"))


def set_id(can_id: int, new: int, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return the frame that changes the id of a drive. new : id"""
    return frames.frame(frames.SET_ID, new << 8 | host, can_id)


def save(can_id: int, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return the frame that saves parameters. NEVER send it to a CyberGear, whose baud rate it changes."""
    return frames.frame(frames.SAVE, host, can_id, COUNTING)


def set_protocol(can_id: int, name: str, host: int = HOST) -> tuple[int, bool, bytes]:
    """Return the frame that selects a protocol after the next power cycle. name : key of PROTOCOLS"""
    return frames.frame(frames.PROTOCOL, host, can_id, bytes([*COUNTING[:6], PROTOCOLS[name], 8]))


def identity(identifier: int, extended: bool, data: bytes, can_id: int) -> str | None:
    """Return the unique number of a drive in hex digits, None for another frame."""
    if extended and identifier == frames.GET_ID << 24 | can_id << 8 | frames.NEWCOMER:
        return bytes(data).hex().upper()
    return None


def reading(
    identifier: int, extended: bool, data: bytes, index: int, can_id: int, host: int = HOST
) -> tuple[bool, bytes] | None:
    """(whether it could be read, the answer's data) of a parameter, None for another frame."""
    if not extended or identifier & 0x1F00FFFF != frames.READ << 24 | can_id << 8 | host or len(data) != 8:
        return None
    return (not identifier >> 16 & 0xFF, bytes(data)) if struct.unpack_from("<H", data)[0] == index else None


def firmware(identifier: int, extended: bool, data: bytes, can_id: int, host: int = HOST) -> str | None:
    """Return the firmware version as text, None for another frame."""
    if not is_feedback(identifier, extended, can_id, host) or bytes(data[:3]) != VERSION + b"\x56":
        return None
    return ".".join(map(str, data[3:]))


def feedback(
    identifier: int, extended: bool, data: bytes, can_id: int, model: Model | None = None, host: int = HOST
) -> Answer | None:
    """Return the Answer of a frame of feedback, None for another frame.

    model : entry of blocks.actuators.robstride.models; without it velocity and torque are None
    """
    if not is_feedback(identifier, extended, can_id, host) or len(data) != 8 or bytes(data[:3]) == VERSION + b"\x56":
        return None
    position, velocity, torque, temperature = struct.unpack(">3Hh", data)
    meanings = frames.meanings(model is not None and model.is_cybergear)
    half = model.wire_position if model is not None else POSITION
    found = Answer(
        EITHER,
        can_id,
        position=symmetric(position, half, 16),
        temperature=temperature / 10.0,
        fault=frames.in_words(identifier >> 16 & 0x3F, meanings),
        enabled=identifier >> 22 & 3 == RUN,
        block="RobStride",
    )
    if model is not None:
        found.velocity, found.torque = (
            symmetric(velocity, model.wire_velocity, 16),
            symmetric(torque, model.wire_torque, 16),
        )
    return found


def is_feedback(identifier: int, extended: bool, can_id: int, host: int = HOST) -> bool:
    """Return whether an identifier is that of a drive's feedback."""
    return extended and identifier & 0x1F00FFFF == frames.FEEDBACK << 24 | can_id << 8 | host


def feedback_of(can_id: int, model: Model | None = None, host: int = HOST) -> Callable[..., Any]:
    """Return a reader of the feedback of one drive."""
    return lambda *frame: feedback(*frame, can_id=can_id, model=model, host=host)


def state_in_mit_mode(
    identifier: int, extended: bool, data: bytes, can_id: int, model: Model | None = None, host: int | None = None
) -> Any:
    """Return the Answer of a drive in the MIT protocol, which replies from its host's id; None for another frame.

    host : host id; by default any id from which no CubeMars replies
    """
    answers = identifier not in (0, can_id) if host is None else identifier == host
    if extended or not answers or len(data) not in (6, 7, 8) or data[0] != can_id:
        return None
    found = common_state(can_id, data, MIT, "RobStrideMIT", POSITION, model)
    found.fault = None
    if len(data) == 8:
        found.temperature = struct.unpack_from(">h", data, 6)[0] / 10.0
    return found


def states_in_mit_mode(
    received: Sequence[tuple[int, bool, bytes]], can_ids: Sequence[int], before: Sequence[tuple[int, bool, bytes]]
) -> list[Answer]:
    """Return the Answers to the query of MIT mode, one for each id.

    In this protocol a drive only replies, so a device that sent before the query is another one.
    """
    unasked = {frame[:2] for frame in before}
    replies = [frame for frame in received if frame[:2] not in unasked]
    found: list[Answer] = []
    for can_id in can_ids:
        answers = [answer for frame in replies if (answer := state_in_mit_mode(*frame, can_id=can_id)) is not None]
        found += one_of(answers, can_id)
    return found


def question(can_id: int) -> Any:
    """Return the frame that requests the identity, None for an id outside the range of this family."""
    return get_id(can_id) if can_id <= 127 else None


def drives(
    received: Sequence[tuple[int, bool, bytes]], can_ids: Sequence[int], before: Sequence[tuple[int, bool, bytes]]
) -> list[Answer]:
    """Return an Answer for each id with an identity."""
    found: list[Answer] = []
    for can_id in can_ids:
        unique = [number for frame in received if (number := identity(*frame, can_id=can_id)) is not None]
        if unique:
            remarks = [same_id(len(unique), can_id)] if len(unique) > 1 else []
            found.append(Answer(EITHER, can_id, unique=" and ".join(unique), remarks=remarks, block="RobStride"))
    return found


def details(answer: Answer) -> Dialogue:
    """Dialogue that stops one drive, and returns the Answer with its state, firmware and voltage."""
    can_id = answer.can_id
    if answer.remarks:  # several drives
        return answer
    found = yield from ask(stop(can_id), STOP_PURPOSE, feedback_of(can_id), attempts=STOPS)
    if found is None:
        silent = "it does not answer a stop: temperature and faults are not known"
        found = Answer(EITHER, can_id, remarks=[silent], block="RobStride")
    found.unique = answer.unique
    read_firmware = partial(firmware, can_id=can_id)
    found.firmware = (yield from ask(version(can_id), VERSION_PURPOSE, read_firmware)) or ""
    found.family = ROBSTRIDE if found.firmware else EITHER
    reply = found.position
    for name, key in (("mechPos", "position"), ("mechVel", "velocity"), ("VBUS", "voltage")):
        number = yield from value(can_id, PARAMETERS[name])
        if number is not None:
            setattr(found, key, number)
    found.notes += range_in_words(reply, found.position)
    return found


def units(can_id: int) -> Dialogue:
    """Dialogue that stops the drives of an id, and returns {unique number: firmware}, "" for a CyberGear's firmware."""
    found: dict[str, str] = {}
    for _ in range(ATTEMPTS):
        yield Send(get_id(can_id), ID_PURPOSE)
        received = yield Listen(REPLY_TIMEOUT, lambda frames: any(identity(*frame, can_id=can_id) for frame in frames))
        received += yield Listen(TWIN_TIMEOUT)
        found = {number: "" for frame in received if (number := identity(*frame, can_id=can_id))}
        if found:
            break
    for number in found:
        read_firmware = partial(firmware, can_id=can_id)
        found[number] = (yield from ask(version(can_id), VERSION_PURPOSE, read_firmware)) or ""
    return found


def range_in_words(reply: float | None, parameter: float | None) -> list[str]:
    """Return what the parameter mechPos suggests about the range of the position, as at most one line.

    reply : rad, position of a reply decoded with ± POSITION; parameter : rad
    """
    if not reply or not parameter or min(abs(reply), abs(parameter)) < SMALL:
        return []
    half = POSITION * parameter / reply
    return [f"its parameter mechPos suggests a range of ±{half:.4g} rad (most models: ±{POSITION:g} rad)"]


def value(can_id: int, parameter: Parameter, is_cybergear: bool = False) -> Dialogue:
    """Dialogue that returns the value of a parameter, None if the drive does not return it."""
    read_value = partial(reading, index=parameter.index, can_id=can_id)
    answer = yield from ask(read(parameter.index, can_id), "readings of RobStride drives", read_value)
    return parameter.value_of(answer[1], is_cybergear) if answer and answer[0] else None


def value_in_mit_mode(can_id: int, parameter: Parameter) -> Dialogue:
    """Dialogue that returns the value of a parameter in the MIT protocol, None if the drive does not return it."""
    request = frames.read_in_mit_mode(parameter.index, can_id)

    def read_value(identifier: int, extended: bool, data: bytes) -> Any:
        answers = (identifier, extended) == request[:2] and len(data) == 8 and data[:2] == request[2][:2]
        return parameter.value_of(data) if answers else None

    return (yield from ask(request, "readings of RobStride drives", read_value))


def commanded(identifier: int, extended: bool, data: bytes) -> Any:
    """Return the id that another controller's frame in the private protocol commands, or None."""
    return identifier & 0xFF if extended and identifier >> 24 in COMMANDS else None
