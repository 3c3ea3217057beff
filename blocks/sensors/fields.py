"""Fields of a packet, as a block declares them: ("force", "int32", "N", 0.01), ("accel", "int16[3]", "m/s²", 9.80665 /
2048).
"""

import keyword
import math
import re
from dataclasses import dataclass
from numbers import Real

from graph import Input, Output, units

# Sizes by type, in the order of cext/kernels/devices/fields_of_bytes.pxd.
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
    """name : of its port; type : a key of SIZES; count : how many, None for one alone; unit; scale : unit of a count"""

    name: str
    type: str
    count: int | None
    unit: str
    scale: float

    @property
    def numbers(self):
        return self.count or 1

    @property
    def size(self):
        return SIZES[self.type] * self.numbers

    @property
    def shape(self):
        return () if self.count is None else (self.count,)

    @property
    def dtype(self):
        """Whole numbers that nothing scales stay whole."""
        return int if self.type.startswith(("int", "uint")) and self.scale == 1.0 else float

    def output(self):
        return Output(
            self.unit, f"{self.type} as it was sent, times {self.scale:g}", shape=self.shape, dtype=self.dtype
        ).named(self.name)

    def input(self):
        default = 0.0 if self.count is None else (0.0,) * self.count
        return Input(
            self.unit, f"that is sent as {self.type}", shape=self.shape, dtype=self.dtype, default=default
        ).named(self.name)


def read(declared, taken):
    """Fields of what a block was given. taken : names that they cannot have; ValueError saying which field is wrong,
    and how
    """
    if not isinstance(declared, (tuple, list)) or not declared:
        raise ValueError('fields are wanted, at least one, as in fields=(("force", "int32", "N", 0.01),)')
    found = [field(each, number) for number, each in enumerate(declared, 1)]
    for each in found:
        if each.name in taken or sum(other.name == each.name for other in found) > 1:
            raise ValueError(f"field {each.name!r}: the name is taken")
    return found


def field(declared, number):
    """Return the Field of a declaration (name, type, unit, scale). Raises ValueError if it is invalid."""
    if not isinstance(declared, (tuple, list)) or not 2 <= len(declared) <= 4:
        raise ValueError(f"field {number} is (name, type, unit, scale), the last two 1 by default, got {declared!r}")
    name, kind, unit, scale = (*declared, *("1", 1.0)[len(declared) - 2 :])
    if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
        raise ValueError(f"field {number}: a name is a word as in Python, got {name!r}")
    match = TYPE.match(kind) if isinstance(kind, str) else None
    if match is None or match[2] == "0":
        raise ValueError(
            f"field {name!r}: a type is one of {', '.join(SIZES)}, or several as in int16[3], got {kind!r}"
        )
    if isinstance(scale, bool) or not isinstance(scale, Real) or not math.isfinite(scale) or scale == 0.0:
        raise ValueError(f"field {name!r}: a scale is a number other than 0, got {scale!r}")
    return Field(name, match[1], int(match[2]) if match[2] else None, units.canonical(unit), float(scale))


def plan(fields, lines, counter):
    """The same for a kernel: whether they come as lines, whether a counter does, bytes of all, then type and scale of
    each.
    """
    return (
        float(lines),
        float(counter),
        float(sum(each.size for each in fields)),
        *(x for each in fields for x in (float(TYPES.index(each.type)), each.scale)),
    )


def clock(fields, name, wrap):
    """For a kernel, of the field of that name: which number it is, s of a count, s after which it begins anew (0:
    never). "" is none.

    wrap : s, 0 for as its type has it. ValueError where there is no such field, or it is no time
    """
    if not name:
        return -1.0, 0.0, 0.0
    found = next((each for each in fields if each.name == name), None)
    if found is None:
        raise ValueError(f"clock is one of the fields, {', '.join(each.name for each in fields)}, got {name!r}")
    try:
        second = units.convert(1.0, found.unit, "s")
    except ValueError:
        second = None
    if second is None or found.count is not None or found.scale < 0.0:
        raise ValueError(
            f'field {name!r} is no clock: that is one number in a unit of time, such as ("{name}", "uint32", "s", 1e-6)'
        )
    count = found.scale * second
    turn = 2.0 ** (8 * found.size) * count if found.type.startswith("uint") else 0.0
    return float(sum(each.numbers for each in fields[: fields.index(found)])), count, float(wrap) or turn
