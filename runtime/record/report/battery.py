"""Text of the battery budget that `check` prints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.host.console.styles import Console


def battery_lines(report: Mapping[str, Any] | None, console: Console) -> list[str]:
    """Return the lines of the section. report : as returned by runtime.session.battery.budget, or None"""
    if report is None:
        return []
    lines = ["", *console.hang(console.bold("battery") + "  ", _size(report), console.faint)]
    width = max((len(drive["actuator"]) for drive in report["drives"]), default=0)
    for drive in report["drives"]:
        lines += console.hang(f"  {drive['actuator']:<{width}}  ", _drive(drive))
    permitted = "" if report["max_current"] is None else f"; the battery permits {report['max_current']:g} A"
    unknown = any(drive["supply_current"] is None for drive in report["drives"])
    which = "every drive with a published current" if unknown else "every drive"
    lines += console.hang("  peak       ", f"at most {report['peak']:.3g} A with {which} at its limit{permitted}")
    used = report["simulated"]
    if used is not None:
        lines += console.hang(
            "  simulated  ",
            f"{used['power']:.3g} W on average: motion {used['mechanical']:.3g} W, heat of the windings "
            f"{used['heat']:.3g} W (estimated), load {report['load']:g} W. A charge lasts {duration(used['time'])}",
        )
    if report["least_time"] is not None:
        lines += console.hang(
            "  at least   ", f"{duration(report['least_time'])}, with every drive at its rated torque and full speed"
        )
    return lines


def _size(report):
    """Return the data of the battery as text."""
    fuse = "" if report["fuse"] is None else f", {report['fuse']:g} A fuse for each drive"
    return f"{report['voltage']:g} V, {report['capacity']:g} A·h, {report['energy']:.3g} W·h{fuse}"


def _drive(drive):
    """Return the currents of one drive as text."""
    if drive["supply_current"] is None:
        return "current not published: not included"
    motor = [f"{name} {drive[f'{name}_current']:.3g} A" for name in ("rated", "peak") if drive[f"{name}_current"]]
    limit = "in a mode that does not bound the torque" if drive["limit"] is None else f"at {drive['limit']:g} N·m"
    return (
        f"at most {drive['supply_current']:.3g} A from the battery, {drive['current']:.3g} A in the motor {limit}"
        + (f" ({', '.join(motor)})" if motor else "")
    )


def duration(hours: float) -> str:
    """Return a duration as text: '35 min', '2.1 h'."""
    return f"{60.0 * hours:.0f} min" if hours < 1.5 else f"{hours:.1f} h"
