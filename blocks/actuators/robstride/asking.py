"""Asking a RobStride drive or a CyberGear in the private protocol how it is, without arming it, and the frames that set
it up.

    get id (type 0), read (type 17)     change nothing
    stop (type 4)                       answered with temperature and faults; leaves every drive as one should be that
    nobody controls

The host's id is 0xFD. Those up to 15 are no choice: `get id` from host 0 is, bit for bit, the command of a duty cycle
to a CubeMars in servo mode.

(RobStride user manuals of 2026-04-28, section 4.1; CyberGear manual, section 4.1.)
"""

import struct

from blocks.actuators.queries import Answer, symmetric
from blocks.actuators.robstride import frames

ROBSTRIDE, CYBERGEAR, EITHER = "RobStride", "CyberGear", "RobStride or CyberGear"
HOST = 0xFD
NEWCOMER = 0xFE  # target of the answer to `get id`
VERSION = bytes([0x00, 0xC4])
POSITION = 12.57  # rad, half the wire range of all but the CyberGear and old firmware
RESET, CALIBRATION, RUN = range(3)
MODES = {RESET: "stopped", CALIBRATION: "calibrating", RUN: "running"}
PROTOCOLS = {"private": 0, "canopen": 1, "mit": 2}
COUNTING = bytes([1, 2, 3, 4, 5, 6, 7, 8])


def get_id(can_id, host=HOST):
    return frames.frame(frames.GET_ID, host, can_id)


def read(index, can_id, host=HOST):
    return frames.read(index, can_id, host)


def write(parameter, value, can_id, is_cybergear=False, host=HOST):
    """parameter : of blocks.actuators.robstride.parameters"""
    value = int(value) if parameter.is_whole(is_cybergear) else float(value)
    data = struct.pack("<Hxx", parameter.index) + struct.pack(parameter.layout(is_cybergear), value)
    return frames.frame(frames.WRITE, host, can_id, data)


def stop(can_id, host=HOST):
    return frames.frame(frames.STOP, host, can_id)


def version(can_id, host=HOST):
    """A stop that a RobStride answers with its firmware. A CyberGear takes it for a stop."""
    return frames.frame(frames.STOP, host, can_id, VERSION.ljust(8, b"\0"))


def set_id(can_id, new, host=HOST):
    return frames.frame(frames.SET_ID, new << 8 | host, can_id)


def set_zero(can_id, host=HOST):
    return frames.frame(frames.SET_ZERO, host, can_id, bytes([1]).ljust(8, b"\0"))


def save(can_id, host=HOST):
    """NEVER to a CyberGear: it changes its baud rate."""
    return frames.frame(frames.SAVE, host, can_id, COUNTING)


def set_protocol(can_id, name, host=HOST):
    return frames.frame(frames.PROTOCOL, host, can_id, bytes([*COUNTING[:6], PROTOCOLS[name], 8]))


def identity(identifier, extended, data, can_id):
    """The drive's unique number in hex digits, None for another frame."""
    if extended and identifier == frames.GET_ID << 24 | can_id << 8 | NEWCOMER:
        return bytes(data).hex().upper()
    return None


def reading(identifier, extended, data, index, can_id, host=HOST):
    """(whether it could be read, the answer's data) of a parameter, None for another frame."""
    if not extended or identifier & 0x1F00FFFF != frames.READ << 24 | can_id << 8 | host or len(data) != 8:
        return None
    return (not identifier >> 16 & 0xFF, bytes(data)) if struct.unpack_from("<H", data)[0] == index else None


def firmware(identifier, extended, data, can_id, host=HOST):
    """Its firmware in words, None for another frame."""
    if not is_feedback(identifier, extended, can_id, host) or bytes(data[:3]) != VERSION + b"\x56":
        return None
    return ".".join(map(str, data[3:]))


def feedback(identifier, extended, data, can_id, model=None, host=HOST):
    """The Answer that a frame of feedback gives, None for another frame.

    model : of blocks.actuators.robstride.models, without which velocity and torque cannot be told
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
    )
    if model is not None:
        found.velocity, found.torque = (
            symmetric(velocity, model.wire_velocity, 16),
            symmetric(torque, model.wire_torque, 16),
        )
    return found


def is_feedback(identifier, extended, can_id, host=HOST):
    return extended and identifier & 0x1F00FFFF == frames.FEEDBACK << 24 | can_id << 8 | host
