"""Frames of the laboratory's drive: standard identifiers, little-endian numbers.

    command    0x500 + id    kind, 0, number (16 bits)
    reply      0x580 + id    0x80 + fault << 1 + enabled, temperature in °C + 40, position in mrad, velocity in
                             0.01 rad/s, torque in 0.01 N·m, 16 bits each

Every command is answered with the state.
"""

import struct

from graph.family import Answer

COMMAND, REPLY = 0x500, 0x580
QUERY, ENABLE, DISABLE, TORQUE, ZERO, SET_ID = range(6)
FAULTS = {1: "over-current", 2: "over-temperature"}
FAMILY = "gait laboratory's drive"


def frame(kind, can_id, number=0):
    return COMMAND + can_id, False, struct.pack("<BBh", kind, 0, number)


def state(identifier, extended, data, can_id, model=None):
    """Return the Answer of a reply from `can_id`, None for another frame."""
    if extended or identifier != REPLY + can_id or len(data) != 8:
        return None
    status, temperature, position, velocity, torque = struct.unpack("<BBhhh", data)
    return Answer(
        FAMILY,
        can_id,
        position=1e-3 * position,
        velocity=1e-2 * velocity,
        torque=1e-2 * torque,
        temperature=temperature - 40.0,
        fault=fault_in_words(status >> 1 & 63),
        enabled=bool(status & 1),
        block="GaitDrive",
    )


def fault_in_words(code):
    return FAULTS.get(code, f"code {code}") if code else ""
