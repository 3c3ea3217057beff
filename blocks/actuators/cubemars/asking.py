"""Asking a CubeMars drive, or a RobStride set to its MIT protocol, how it is, without arming it.

The question is DISABLE. It is answered with the state, as every frame of MIT mode is, and of the frames that are
answered it is the safest:

    enable (FC)         arms the drive, and with it whatever it was last told
    zero torque         eight bytes whose meaning rests on the firmware's layout and ranges: other boards read a
    stiffness where these
                        have a position; and a drive that somebody has left enabled stays so
    disable (FD)        has no fields that could be misread, and leaves every drive as a drive should be that nobody
    controls

(AK Series Module Driver Manual V1.0.18, pages 64 to 68; RobStride user manuals of 2026-04-28, section 6.)
"""

import math
import struct

from blocks.actuators.cubemars import frames
from blocks.actuators.cubemars.mit import FAULTS, REPLIES
from blocks.actuators.cubemars.models import POSITION
from blocks.actuators.mit_frames import DISABLE
from blocks.actuators.queries import Answer, symmetric

MIT, SERVO, ROBSTRIDE_MIT = (
    "CubeMars in MIT mode",
    "CubeMars in servo mode, or a V3.0 board",
    "RobStride in its MIT protocol",
)
V3 = "CubeMars with a V3.0 board"
DISABLED = 0x77  # error byte of a V3.0 board's answer to a disable
ROBSTRIDE_POSITION = 12.57  # rad, half the wire range of every model with this protocol


def question(can_id):
    return can_id, False, DISABLE


def answer(identifier, extended, data, can_id, model=None):
    """The Answer to a question, None for another frame.

    model : of blocks.actuators.cubemars.models or robstride.models, without which velocity and torque cannot be told
    """
    if extended or len(data) not in REPLIES or data[0] != can_id or bytes(data) == DISABLE:
        return None
    family = MIT if identifier in (0, can_id) else ROBSTRIDE_MIT  # which answers from its host's id
    half = model.wire_position if model is not None else POSITION if family == MIT else ROBSTRIDE_POSITION
    found = Answer(family, can_id, position=symmetric(data[1] << 8 | data[2], half, 16))
    if model is not None:
        found.velocity = symmetric(data[3] << 4 | data[4] >> 4, model.wire_velocity, 12)
        found.torque = symmetric((data[4] & 15) << 8 | data[5], model.wire_torque, 12)
    if len(data) != 8:
        found.fault = None
    if len(data) != 8 and family == MIT:
        found.notes.append(
            f"replies of {len(data)} bytes, without temperature and error: its block needs reply={len(data)}"
        )
        found.settings["reply"] = len(data)
    if len(data) == 8 and family == ROBSTRIDE_MIT:
        found.temperature = struct.unpack_from(">h", data, 6)[0] / 10.0
        found.fault = None
    elif len(data) == 8:
        found.temperature = data[6] - 40.0
        found.fault = FAULTS.get(data[7], f"code {data[7]}, which the manual does not know") if data[7] else ""
    return found


def other_id(identifier, extended, data, can_id):
    """The id in byte 0 of a reply from `can_id` that names another one, None for another frame."""
    if extended or identifier != can_id or len(data) not in REPLIES or data[0] == can_id or bytes(data) == DISABLE:
        return None
    return data[0]


def question_of_v3(can_id):
    """Disable, an empty frame: boards V1 and V2 have none, and a RobStride takes it for `get id`."""
    return frames.frame(frames.DISABLE, can_id)


def servo_status(identifier, extended, data, model=None):
    """The Answer that a drive in servo mode or with a V3.0 board gives, mostly without being asked, None for another
    frame.

    model : of blocks.actuators.cubemars.models or models_v3; without it velocity, and torque, which is computed from
        the current, cannot be told
    """
    if not extended or identifier >> 8 != frames.STATUS or len(data) != 8:
        return None
    position, speed, current, temperature, error = struct.unpack(">hhhbB", data)
    found = Answer(
        SERVO,
        identifier & 0xFF,
        position=position * frames.POSITION_CODE,
        current=current * 0.01,
        temperature=float(temperature),
    )
    if model is not None:
        _, rate, torque = frames.scales(model, 1.0, model.torque_constant or math.nan)
        found.velocity, found.torque = speed * rate, current * 0.01 * torque
    if error == DISABLED:
        found.family = V3
    else:
        found.fault = frames.in_words(error) if error else ""
        found.notes.append(
            "its blocks are CubeMarsServo and, with a V3.0 board, CubeMarsV3; CubeMars wants MIT mode, set with the "
            "vendor's tool"
        )
    return found
