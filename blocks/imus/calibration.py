"""Calibration of one IMU: the result of `python -m runtime calibrate`, in a TOML file.

    [accelerometer]             # m/s²: accel = matrix (measured − offset)
    offset = [0.1, 0.0, -0.2]
    matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

    [gyroscope]                 # rad/s: gyro = measured − bias
    bias = [0.01, 0.0, 0.0]

    [magnetometer]              # µT: mag = matrix (measured − offset)
    offset = [12.0, 0.0, 3.0]
    matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

A part that is missing changes nothing.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from cext.user_files import read_small
from graph.narrowing import is_row, is_table

Vector: TypeAlias = tuple[float, ...]

NOTHING = (0.0, 0.0, 0.0)
SAME = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
PARTS = {"accelerometer": ("offset", "matrix"), "gyroscope": ("bias",), "magnetometer": ("offset", "matrix")}
FIELDS = {
    "accelerometer": ("accel_offset", "accel_matrix"),
    "gyroscope": ("gyro_bias",),
    "magnetometer": ("mag_offset", "mag_matrix"),
}
ABOUT = "sensor"  # table with the source of the calibration, for information


@dataclass(frozen=True)
class Calibration:
    """Offsets in m/s² and µT, bias in rad/s, matrices of three rows."""

    accel_offset: Vector = NOTHING
    accel_matrix: tuple[Vector, ...] = SAME
    gyro_bias: Vector = NOTHING
    mag_offset: Vector = NOTHING
    mag_matrix: tuple[Vector, ...] = SAME

    @classmethod
    def read(cls, path: str | Path) -> Calibration:
        """Return the Calibration of a file. Raises ValueError with the cause, OSError if it cannot be read."""
        return cls.of(read_small(path).decode("utf-8-sig"), path)

    @classmethod
    def of(cls, text: str, path: str | Path = "calibration") -> Calibration:
        """Return the Calibration in the text of a calibration file. Raises ValueError. path : file named in messages"""
        try:
            content = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{path}: invalid TOML: {error}") from None
        stranger = next((name for name in content if name not in (*PARTS, ABOUT)), None)
        if stranger is not None:
            raise ValueError(f"{path}: unknown table [{stranger}]: expected {', '.join(PARTS)}")
        return cls(
            accel_offset=vector(content, "accelerometer", "offset", path),
            accel_matrix=matrix(content, "accelerometer", path),
            gyro_bias=vector(content, "gyroscope", "bias", path),
            mag_offset=vector(content, "magnetometer", "offset", path),
            mag_matrix=matrix(content, "magnetometer", path),
        )

    @staticmethod
    def parts_of(text: str) -> list[str]:
        """Return the names of the parts in the text of a file."""
        return [part for part in PARTS if part in tomllib.loads(text)]

    def with_parts(self, other: Calibration, parts: Sequence[str]) -> Calibration:
        """Return this calibration with some parts of another."""
        fields = {name: getattr(other, name) for part in parts for name in FIELDS[part]}
        return replace(self, **fields)

    def text(self, about: dict[str, str] | None = None, parts: Sequence[str] = tuple(PARTS)) -> str:
        """Return the text of the file.

        about : {name: text or number} of the sensor and the measurement
        parts : names of the calibrated parts
        """
        lines: list[str] = []
        if about:
            lines += [f"[{ABOUT}]", *(f"{name} = {quoted(value)}" for name, value in about.items()), ""]
        if "accelerometer" in parts:
            lines += [
                "[accelerometer]             # m/s²: accel = matrix (measured - offset)",
                f"offset = {numbers(self.accel_offset)}",
                *rows(self.accel_matrix),
                "",
            ]
        if "gyroscope" in parts:
            lines += [
                "[gyroscope]                 # rad/s: gyro = measured - bias",
                f"bias = {numbers(self.gyro_bias)}",
                "",
            ]
        if "magnetometer" in parts:
            lines += [
                "[magnetometer]              # µT: mag = matrix (measured - offset)",
                f"offset = {numbers(self.mag_offset)}",
                *rows(self.mag_matrix),
                "",
            ]
        return "\n".join(lines)


def is_number(x: object) -> bool:
    """Return whether a value is a finite int or float."""
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x)


def table(content: dict[str, Any], part: str, path: str | Path) -> dict[str, Any]:
    """Return a table of a calibration file; {} if it is missing. Raises ValueError.

    content : parsed content of the file
    part : name of the table
    path : file named in messages
    """
    found = content.get(part, {})
    if not is_table(found):
        raise ValueError(f"{path}: {part} must be a table: write [{part}]")
    stranger = next((name for name in found if name not in PARTS[part]), None)
    if stranger is not None:
        raise ValueError(f"{path}: [{part}]: unknown key {stranger!r}: expected {', '.join(PARTS[part])}")
    return found


def vector(content: dict[str, Any], part: str, name: str, path: str | Path) -> Vector:
    """Return three numbers of a calibration file; zeros if they are missing. Raises ValueError.

    part : name of the table; name : name of the key
    """
    value = table(content, part, path).get(name, NOTHING)
    if not (is_row(value) and len(value) == 3 and all(map(is_number, value))):
        raise ValueError(f"{path}: [{part}] {name}: expected three finite numbers, got {value!r}")
    return tuple(map(float, value))


def matrix(content: dict[str, Any], part: str, path: str | Path) -> tuple[Vector, ...]:
    """Return the matrix of a table as three rows; the identity if it is missing. Raises ValueError."""
    value = table(content, part, path).get("matrix", SAME)
    if not (
        is_row(value)
        and len(value) == 3
        and all(is_row(row) and len(row) == 3 and all(map(is_number, row)) for row in value)
    ):
        raise ValueError(f"{path}: [{part}] matrix: expected three rows of three finite numbers, got {value!r}")
    return tuple(tuple(map(float, row)) for row in value)


def numbers(values: Vector) -> str:
    """Return three numbers in TOML."""
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def rows(values: tuple[Vector, ...]) -> list[str]:
    """Return the lines of a matrix in TOML."""
    return ["matrix = [", *(f"    {numbers(row)}," for row in values), "]"]


def quoted(value: str) -> str:
    """Return a number or text in TOML."""
    return (
        repr(value)
        if isinstance(value, (int, float))
        else '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'
    )
