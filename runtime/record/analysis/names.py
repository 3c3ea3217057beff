"""Names and units for people: "knee position, left" in degrees for left/knee.position in rad."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

SIDES = ("left", "right")  # subsystems that name a side of the body
DEGREES = {"rad": "°", "rad/s": "°/s", "rad/s²": "°/s²"}  # units in which people read angles
AXES = "xyz"
WORDS = {"rms": "RMS", "imu": "IMU", "emg": "EMG", "fsr": "FSR"}


def shown_unit(unit: str) -> tuple[str, float]:
    """Return (unit for people, factor by which a value is multiplied)."""
    if unit in DEGREES:
        return DEGREES[unit], 180.0 / math.pi
    return ("" if unit in ("1", "any") else unit), 1.0


def words_of(name: str) -> str:
    """Return the words of a name of the program: "RMS torque" for rms_torque."""
    return " ".join(WORDS.get(word, word) for word in name.split("_") if word)


def block_name(path: str) -> str:
    """Return the name of a block: "knee, left" for left/knee, "gait phase" for gait_phase."""
    *outer, name = path.split("/")
    side = outer.pop(0) if outer and outer[0] in SIDES else ""
    words = " ".join(map(words_of, [*outer, name]))
    return f"{words}, {side}" if side else words


def port_name(port: str, triple: bool = False) -> str:
    """Return the name of a port, or of an element of one. triple : whether it is one of three, along x, y and z"""
    element = re.fullmatch(r"(\w+)\[(\d+)\]", port)
    if element is None:
        return words_of(port)
    index = AXES[int(element[2])] if triple else element[2]
    return f"{words_of(element[1])} {index}"


def split(path: str) -> tuple[str, str]:
    """Return (path of the block, name of the port or parameter) of a signal or live parameter."""
    block, dot, port = path.rpartition(".")
    return (block, port) if dot else ("", path)


def describe(entries: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return entries with a path and a unit, each with `block`, `port`, `shown` (unit) and `factor` for people."""
    entries = list(entries)
    sizes: dict[str, int] = {}
    for entry in entries:
        whole = entry["path"].partition("[")[0]
        sizes[whole] = sizes.get(whole, 0) + 1
    described = []
    for entry in entries:
        block, port = split(entry["path"])
        unit, factor = shown_unit(entry["unit"])
        triple = sizes[entry["path"].partition("[")[0]] == len(AXES)
        described.append(
            {**entry, "block": block_name(block), "port": port_name(port, triple), "shown": unit, "factor": factor}
        )
    return described
