"""Ports and parameters shared by blocks of several files."""

from __future__ import annotations

import keyword
import math
import re
import unicodedata
from collections.abc import Container, Iterable
from numbers import Real
from typing import Any

from graph import Input, Param, units
from graph.narrowing import is_row


def several(count: int, unit: str = "any", dtype: type = float) -> dict[str, Input]:
    """Return inputs u1, u2, ... of any shape, for `inputs` of a block during `configure`."""
    return {f"u{i}": Input(unit, f"input {i}", shape=..., dtype=dtype).named(f"u{i}") for i in range(1, count + 1)}


def count_param() -> Param[int]:
    """Return the declaration of the number of inputs of a block with `several`."""
    return Param(2, "1", "number of inputs", min=2, max=1000, fixed=True)


class UnitOfOutput:
    """Mixin of blocks whose parameter `unit` is the unit of their output y."""

    def configure(self) -> None:
        """Check the parameter `unit` and write it in its canonical form. Raises ValueError."""
        self.unit = units.canonical(self.unit)

    def output_units(self, **inputs: str) -> dict[str, str]:
        """Return the unit of `y`, whatever those of the inputs are."""
        return {"y": self.unit}


def finite_numbers(name: str, values: tuple[float, ...]) -> tuple[float, ...]:
    """Return a tuple of at least one finite float. ValueError for other values."""
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if not numbers or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name} must contain at least one number, all finite, got {values!r}")
    return numbers


def port_name(name: str, taken: Container[str], suffix: str) -> str:
    """Return a name in a file as the name of a port. suffix : of a name that is a keyword or taken"""
    name = re.sub(r"\W", "_", name)
    if not name.isidentifier() or name.startswith("_"):
        name = f"x{name}"
    return name + suffix if keyword.iskeyword(name) or name in taken else name


def check_port_names(names: Iterable[object], reserved: Container[str]) -> None:
    """Raise ValueError for a name that occurs twice, is reserved, or is not an identifier."""
    seen: set[str] = set()
    for name in names:
        refused = f"{name!r} cannot be the name of a port"
        if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
            raise ValueError(f"{refused}: it must be a Python identifier that does not begin with _")
        if (written := unicodedata.normalize("NFKC", name)) != name:
            raise ValueError(f"{refused}: Python reads it as {written!r}. Use that name")
        if name in reserved or name in seen or name == "self":
            raise ValueError(f"{refused}: it is {'used twice' if name in seen else 'reserved'}. Use another name")
        seen.add(name)


def unit_and_limits(name: str, stated: Any) -> tuple[str, tuple[float, float] | None]:
    """Return the unit and the limits of an entry of `gives`. Raises ValueError."""
    unit, *limits = stated if is_row(stated) and stated else (stated,)
    numbers = all(isinstance(limit, Real) for limit in limits)
    if not isinstance(unit, str) or limits and not (len(limits) == 2 and numbers and limits[0] <= limits[1]):
        raise ValueError(f"gives: {name} must be a unit, or (unit, lowest, highest value), got {stated!r}")
    return unit, (limits[0], limits[1]) if limits else None
