"""Groups of signals for plots: one per subsystem, with a plot per unit; counts and states have plots of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from runtime.record.storage.messages import split

if TYPE_CHECKING:
    from collections.abc import Iterable

PLOTS, CURVES = 6, 12  # largest number of plots of a subsystem, and of curves in a plot
FIRST = ("rad", "N·m", "rad/s", "m/s²", "A", "1")  # units of the first plots, in this order
PLAIN = ("1", "any")


def by_unit(name: str, signals: Iterable[dict[str, Any]]) -> dict[str, list[tuple[str, list[str]]]]:
    """Return {subsystem: [(title of a plot, [path])]}, in the order of the signals.

    name : name of the diagram, for signals outside subsystems
    signals : [{"path", "unit", "dtype"}]
    """
    units_of: dict[str, dict[tuple[bool, str], list[str]]] = {}
    for signal in signals:
        folder, _, _ = split(signal["path"])
        whole = signal["dtype"] != "float"
        units_of.setdefault(folder or name, {}).setdefault((whole, signal["unit"]), []).append(signal["path"])
    groups: dict[str, list[tuple[str, list[str]]]] = {}
    for title, units in units_of.items():
        order = sorted(units, key=lambda kind: (kind[0], FIRST.index(kind[1]) if kind[1] in FIRST else len(FIRST)))
        groups[title] = [(heading(title, *kind), units[kind][:CURVES]) for kind in order[:PLOTS]]
    return groups


def heading(title: str, whole: bool, unit: str) -> str:
    """Return the title of a plot. title : title of its group; whole : whether the signals are ints or bools"""
    if unit not in PLAIN:
        return f"{title} [{unit}]"
    return f"{title}, counts and states" if whole else title
