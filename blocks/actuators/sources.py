"""Class and source of the numbers in the tables of actuators."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, ClassVar

from msgspec import Struct

KINDS = MANUAL, FIRMWARE, TWO, ONE, ASSUMED = "manual", "firmware", "two sources", "one source", "assumed"
WIRES = ("wire_position", "wire_velocity", "wire_stiffness", "wire_damping", "wire_torque")


class Source(Struct, frozen=True):
    """Source of a number. kind : its class, one of the five above; text : where it stands, or why it is assumed"""

    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.text}"


class RangeSet(Struct, frozen=True):
    """Encoded ranges of a model according to one of several sources that disagree.

    name : of the parameter `ranges`
    values : half ranges of position and velocity, largest stiffness and damping, half range of torque
    """

    name: str
    values: tuple[float, ...]
    source: Source


class Sourced:
    """A model whose numbers have sources: those of the table, and its own.

    SOURCES : {column: Source} of the table; sources : ((column, Source), ...) of the model, which take precedence
    range_sets : RangeSets of a model whose sources disagree; the first has the ranges of the model
    """

    name: str
    SOURCES: ClassVar[dict[str, Source]] = {}
    sources: tuple[tuple[str, Source], ...] = ()
    range_sets: tuple[RangeSet, ...] = ()

    def source(self, column: str) -> Source:
        """Return the Source of a number. Raises KeyError for a column without one."""
        return dict(self.sources).get(column) or self.SOURCES[column]

    def assumed(self, *columns: str) -> dict[str, str]:
        """Return {column: reason} of the numbers that are assumed."""
        return {name: self.source(name).text for name in columns if self.source(name).kind == ASSUMED}


def with_ranges(model: Any, name: str) -> Any:
    """Return a model with the ranges of one of its RangeSets. Raises ValueError for a name without one."""
    if not name:
        return model
    sets: dict[str, RangeSet] = {each.name: each for each in getattr(model, "range_sets", ())}
    if name not in sets:
        known = f"must be one of {', '.join(map(repr, sets))}" if sets else "must be omitted: its sources agree"
        raise ValueError(f"ranges of {model.name} {known}; got {name!r}")
    return replace(model, **dict(zip(WIRES, sets[name].values)))


def of(columns: Iterable[str], kind: str, text: str) -> tuple[tuple[str, Source], ...]:
    """Return the entries of several columns with one source, for `Sourced.sources`."""
    return tuple((name, Source(kind, text)) for name in columns)
