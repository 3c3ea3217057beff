"""RobStride's private protocol the slow way: exact fractions and struct, from the layout in the manual.

RobStride user manuals of 2026-04-28, section 4.1. A code is ⌊(x − low) 65535 / (high − low)⌋, clamped.
"""

import struct

from tests.blocks.actuators.reference import code, value

EXTENDED = 0x80000000  # the flag that a frame of ours carries in its identifier
HOST = 0xFD


def ranges(model):
    """(low, high) of each field."""
    half = {"position": model.wire_position, "velocity": model.wire_velocity, "torque": model.wire_torque}
    return {
        **{name: (-x, x) for name, x in half.items()},
        "stiffness": (0.0, model.wire_stiffness),
        "damping": (0.0, model.wire_damping),
    }


def identifier(kind, field, target):
    return EXTENDED | kind << 24 | field << 8 | target


def command(limits, can_id, **fields):
    """(identifier, data) of operation control."""
    codes = {name: code(x, *limits[name], 16) for name, x in fields.items()}
    data = struct.pack(">4H", *(codes[name] for name in ("position", "velocity", "stiffness", "damping")))
    return identifier(1, codes["torque"], can_id), data


def codes_of(frame):
    """The five codes of operation control, by name."""
    identifier, data = frame
    assert identifier >> 24 == (EXTENDED | 1 << 24) >> 24
    return {
        **dict(zip(("position", "velocity", "stiffness", "damping"), struct.unpack(">4H", data))),
        "torque": identifier >> 8 & 0xFFFF,
    }


def read_command(limits, frame):
    return {name: value(k, *limits[name], 16) for name, k in codes_of(frame).items()}


def reply(
    limits, can_id, position=0.0, velocity=0.0, torque=0.0, temperature=25.0, faults=0, mode=2, host=HOST, kind=2
):
    """(identifier, data) of feedback."""
    given = {"position": position, "velocity": velocity, "torque": torque}
    data = struct.pack(">3Hh", *(code(x, *limits[name], 16) for name, x in given.items()), round(temperature * 10))
    return identifier(kind, mode << 14 | faults << 8 | can_id, host), data


def read_reply(limits, frame):
    """(motor, host, mode, faults, position, velocity, torque, temperature)."""
    identifier, data = frame
    *codes, temperature = struct.unpack(">3Hh", data)
    motion = [value(k, *limits[name], 16) for name, k in zip(("position", "velocity", "torque"), codes)]
    return (
        identifier >> 8 & 255,
        identifier & 255,
        identifier >> 22 & 3,
        identifier >> 16 & 63,
        *motion,
        temperature / 10,
    )


def write(index, number, can_id, host=HOST, layout="<f"):
    """(identifier, data) of a parameter that is written."""
    return identifier(18, host, can_id), struct.pack("<HH", index, 0) + struct.pack(layout, number)
