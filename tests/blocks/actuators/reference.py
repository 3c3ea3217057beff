"""MIT mode of CubeMars AK, boards V1 and V2, the slow way: exact fractions and strings of bits, from the layout in the
manual.

AK Series Module Driver Manual V1.0.18, pages 64 to 68. Of the three quantisations in the wild this is the one of MIT's
firmware, which does not wrap at the top: code = ⌊(x − low) (2ⁿ − 1) / (high − low)⌋, clamped to 0 and 2ⁿ − 1. Everybody
decodes with 2ⁿ − 1.
"""

import math
from fractions import Fraction
from functools import lru_cache

FIELDS = (("position", 16), ("velocity", 12), ("stiffness", 12), ("damping", 12), ("torque", 12))
BITS = dict(FIELDS)


def ranges(velocity, torque, position=12.5):
    """(low, high) of each field, given half of the model's range of velocity, in rad/s, torque, in N·m, and position,
    in rad.
    """
    return {
        "position": (-position, position),
        "velocity": (-velocity, velocity),
        "stiffness": (0.0, 500.0),
        "damping": (0.0, 5.0),
        "torque": (-torque, torque),
    }


@lru_cache(1 << 14)
def exact_code(x, low, high, bits):
    """The code before truncation, as a Fraction within 0 and 2ⁿ − 1."""
    if not math.isfinite(x):
        raise ValueError(f"{x} has no code")
    share = (Fraction(x) - Fraction(low)) / (Fraction(high) - Fraction(low))
    return min(max(share, Fraction(0)), Fraction(1)) * (2**bits - 1)


def code(x, low, high, bits):
    return int(exact_code(x, low, high, bits))


@lru_cache(1 << 14)
def value(code, low, high, bits):
    return float(Fraction(low) + Fraction(code) * (Fraction(high) - Fraction(low)) / (2**bits - 1))


def codes_of(data):
    """The five codes of a command of eight bytes, by name."""
    assert len(data) == 8
    text = "".join(f"{byte:08b}" for byte in data)
    codes = {}
    for name, bits in FIELDS:
        codes[name], text = int(text[:bits], 2), text[bits:]
    return codes


def command(limits, **fields):
    """The eight bytes of a command: p16 v12 kp12 kd12 t12, most significant bit first."""
    text = "".join(f"{code(fields[name], *limits[name], bits):0{bits}b}" for name, bits in FIELDS)
    return bytes(int(text[i : i + 8], 2) for i in range(0, 64, 8))


def read_command(limits, data):
    """What a drive understands of a command."""
    return {name: value(code, *limits[name], BITS[name]) for name, code in codes_of(data).items()}


def reply(limits, can_id, position, velocity, torque, temperature, error):
    """The eight bytes of a reply: id, p16 v12 t12, temperature in °C + 40, error."""
    given = {"position": position, "velocity": velocity, "torque": torque}
    text = "".join(f"{code(x, *limits[name], BITS[name]):0{BITS[name]}b}" for name, x in given.items())
    return bytes([can_id, *(int(text[i : i + 8], 2) for i in range(0, 40, 8)), int(temperature) + 40, error])


def held_reply(limits, can_id, position, data, temperature=30.0, error=0):
    """The reply to a frame of a drive whose joint is held still: it gives the torque of its law, none after a frame of
    seven FF.
    """
    torque = 0.0
    if data[:7] != bytes(7 * [0xFF]):
        asked = read_command(limits, data)
        torque = (
            asked["stiffness"] * (asked["position"] - position) + asked["damping"] * asked["velocity"] + asked["torque"]
        )
    return reply(
        limits, can_id, position, 0.0, min(max(torque, limits["torque"][0]), limits["torque"][1]), temperature, error
    )


def read_reply(limits, data):
    """(motor, position, velocity, torque, temperature in °C, error) of a reply of eight bytes."""
    assert len(data) == 8
    text = "".join(f"{byte:08b}" for byte in data[1:6])
    codes = int(text[:16], 2), int(text[16:28], 2), int(text[28:], 2)
    motion = [value(code, *limits[name], BITS[name]) for name, code in zip(("position", "velocity", "torque"), codes)]
    return data[0], *motion, data[6] - 40.0, data[7]
