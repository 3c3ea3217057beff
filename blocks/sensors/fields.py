"""Typed fields of a packet: ("force", "int32", "N", 0.01), ("accel", "int16[3]", "m/s²", 9.80665 / 2048)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

from blocks._plumbing.ports import check_port_names
from graph import Input, Interval, Output, units
from graph.narrowing import is_row

# Size in bytes by type, in the order of cext/kernels/devices/fields_of_bytes.pxd.
SIZES = {
    "uint8": 1,
    "int8": 1,
    "uint16": 2,
    "int16": 2,
    "int24": 3,
    "uint32": 4,
    "int32": 4,
    "float32": 4,
    "float64": 8,
}
TYPES = list(SIZES)
TYPE = re.compile(rf"^({'|'.join(SIZES)})(?:\[(\d+)\])?$")


@dataclass(frozen=True)
class Field:
    """Field of a packet.

    name : name of the port
    type : key of SIZES
    count : number of elements, None for a scalar
    unit : unit of the port
    scale : value of one count in that unit
    """

    name: str
    type: str
    count: int | None
    unit: str
    scale: float

    @property
    def numbers(self) -> int:
        """Number of values."""
        return self.count or 1

    @property
    def size(self) -> int:
        """Size in bytes."""
        return SIZES[self.type] * self.numbers

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its port: () for a single value."""
        return () if self.count is None else (self.count,)

    @property
    def dtype(self) -> type:
        """Type of the port: int for unscaled integers, otherwise float."""
        return int if self.type.startswith(("int", "uint")) and self.scale == 1.0 else float

    @property
    def range(self) -> Interval | None:
        """Range of its port: that of its type, None for floating point."""
        if self.type.startswith("float"):
            return None
        bits, signed = 8 * SIZES[self.type], self.type.startswith("int")
        low, high = (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1.0) if signed else (0.0, 2.0**bits - 1.0)
        return Interval(*sorted((self.scale * low, self.scale * high)))

    def output(self) -> Output:
        """Return the output of a sensor that receives it."""
        return Output(
            self.unit, f"transmitted {self.type} times {self.scale:g}", shape=self.shape, dtype=self.dtype
        ).named(self.name)

    def input(self) -> Input:
        """Return the input of an emulator that transmits it."""
        default = 0.0 if self.count is None else (0.0,) * self.count
        return Input(
            self.unit, f"value to transmit as {self.type}", shape=self.shape, dtype=self.dtype, default=default
        ).named(self.name)


def read(declared: tuple[tuple[str | float, ...], ...], taken: set[str]) -> list[Field]:
    """Return the Fields of a declaration.

    declared : sequence of (name, type, unit, scale); taken : reserved names. ValueError for an invalid field.
    """
    if not is_row(declared) or not declared:
        raise ValueError('fields must contain at least one field, as in fields=(("force", "int32", "N", 0.01),)')
    fields = [field(each, number) for number, each in enumerate(declared, 1)]
    check_port_names((each.name for each in fields), taken)
    return fields


def field(declared: tuple[str | float, ...], number: int) -> Field:
    """Return the Field of a declaration (name, type, unit, scale). Raises ValueError if it is invalid."""
    if not is_row(declared) or not 2 <= len(declared) <= 4:
        raise ValueError(
            f"field {number} must be (name, type, unit, scale), where unit and scale are 1 by default, got {declared!r}"
        )
    name, kind, unit, scale = (*declared, *("1", 1.0)[len(declared) - 2 :])
    if not isinstance(name, str):
        raise ValueError(f"field {number}: the name must be text, got {name!r}")
    match = TYPE.match(kind) if isinstance(kind, str) else None
    if match is None or match[2] == "0":
        raise ValueError(
            f"field {name!r}: the type must be one of {', '.join(SIZES)}, or an array such as int16[3], got {kind!r}"
        )
    if isinstance(scale, bool) or not isinstance(scale, Real) or not math.isfinite(scale) or scale == 0.0:
        raise ValueError(f"field {name!r}: the scale must be a nonzero number, got {scale!r}")
    return Field(name, match[1], int(match[2]) if match[2] else None, units.canonical(unit), float(scale))


def plan(fields: Sequence[Field], lines: bool, counter: bool) -> tuple[float, ...]:
    """Return the fields as the plan of a kernel.

    The plan is: 1 for text lines, 1 with a counter, total bytes, then type and scale of each field.
    """
    return (
        float(lines),
        float(counter),
        float(sum(each.size for each in fields)),
        *(x for each in fields for x in (float(TYPES.index(each.type)), each.scale)),
    )


def clock(fields: Sequence[Field], name: str, wrap: float) -> tuple[float, float, float]:
    """Return (index, s per count, wrap period in s) of the clock field for a kernel.

    A wrap period of 0 means never. ValueError if there is no such field, or its unit is not a unit of time.

    name : name of the field, "" for none; wrap : wrap period in s, 0 to derive it from the type
    """
    if not name:
        return -1.0, 0.0, 0.0
    match = next((each for each in fields if each.name == name), None)
    if match is None:
        raise ValueError(f"clock must be one of the fields {', '.join(each.name for each in fields)}, got {name!r}")
    try:
        second = units.convert(1.0, match.unit, "s")
    except ValueError:
        second = None
    if second is None or match.count is not None or match.scale < 0.0:
        raise ValueError(
            f"field {name!r} cannot be the clock: it must be a scalar in a unit of time, such as "
            f'("{name}", "uint32", "s", 1e-6)'
        )
    count = match.scale * second
    turn = 2.0 ** (8 * match.size) * count if match.type.startswith("uint") else 0.0
    return float(sum(each.numbers for each in fields[: fields.index(match)])), count, float(wrap) or turn
