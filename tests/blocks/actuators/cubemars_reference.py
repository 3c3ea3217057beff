"""CubeMars boards in extended frames, the slow way: exact fractions and strings of bits, from the layouts in the
manuals.

AKA Series Product Manual V3.0.0, section 4; AK Series Module Driver Manual V1.0.18. An identifier is (kind << 8) | id.
"""

import math
from fractions import Fraction

from tests.blocks.actuators.reference import code, value
from tests.blocks.actuators.wire import EXTENDED

# in the order of the wire
FORCE = (("stiffness", 12), ("damping", 12), ("position", 16), ("velocity", 12), ("torque", 12))
BITS = dict(FORCE)
STATUS = 0x29
UNITS = {
    "duty": 100_000,
    "current": 1000,
    "current_brake": 1000,
    "velocity": 1,
    "position": 10_000,
    "position_velocity": 10_000,
}
KINDS = {"duty": 0, "current": 1, "current_brake": 2, "velocity": 3, "position": 4, "position_velocity": 6}


def ranges(model):
    """(low, high) of each field of force control."""
    return {
        "position": (-12.56, 12.56),
        "velocity": (-model.wire_velocity, model.wire_velocity),
        "stiffness": (0.0, 500.0),
        "damping": (0.0, 5.0),
        "torque": (-model.wire_torque, model.wire_torque),
    }


def identifier(kind, can_id):
    return EXTENDED | kind << 8 | can_id


def force_codes(data):
    text = "".join(f"{byte:08b}" for byte in data)
    assert len(text) == 64
    codes = {}
    for name, bits in FORCE:
        codes[name], text = int(text[:bits], 2), text[bits:]
    return codes


def force(limits, **fields):
    """The eight bytes of a command of force control."""
    text = "".join(f"{code(fields[name], *limits[name], bits):0{bits}b}" for name, bits in FORCE)
    return bytes(int(text[i : i + 8], 2) for i in range(0, 64, 8))


def read_force(limits, data):
    return {name: value(code, *limits[name], BITS[name]) for name, code in force_codes(data).items()}


def signed(number, length):
    return int(number).to_bytes(length, "big", signed=True)


def status(can_id, position=0, velocity=0, current=0, temperature=25, error=0, kind=STATUS):
    """(identifier, data) of a report, of whole codes."""
    words = b"".join(signed(code, 2) for code in (position, velocity, current))
    return identifier(kind, can_id), words + signed(temperature, 1) + bytes([error])


def turns(model):
    """Electrical revolutions a minute of 1 rad/s of the output."""
    return Fraction(30) / Fraction(math.pi) * model.gear * model.pole_pairs


def read_status(model, constant, data, *, sign=1, offset=0.0, ratio=1.0):
    """Decode the joint state of a report: (position, velocity, current, torque, temperature)."""
    position, velocity, current = (int.from_bytes(data[i : i + 2], "big", signed=True) for i in (0, 2, 4))
    current = sign * current / 100
    return (
        sign * math.radians(position / 10) / ratio - offset,
        sign * float(velocity * 10 / turns(model)) / ratio,
        current,
        current * constant * ratio,
        int.from_bytes(data[6:7], "big", signed=True),
    )


def servo_code(mode, model, x, *, sign=1, offset=0.0, ratio=1.0):
    """The whole number that a command is, before truncation, as a Fraction. x : at the joint"""
    if mode == "current_brake":
        return Fraction(x) * 1000
    if mode in ("duty", "current"):
        return sign * Fraction(x) * UNITS[mode]
    if mode == "velocity":
        return sign * Fraction(x) * Fraction(ratio) * turns(model)
    return sign * (Fraction(x) + Fraction(offset)) * Fraction(ratio) * 180 / Fraction(math.pi) * 10_000
