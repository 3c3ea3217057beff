"""Battery of a rig, and what its drives take from it at most.

    [battery]
    voltage = 24.0
    capacity = 4.0
    max_current = 40.0
    fuse = 20.0
    load = 15.0

An inverter converts power: at full modulation its supply current is √3/2 of the amplitude of the phase current, and
lower below that. (Space-vector modulation: a phase voltage of at most supply / √3, and P = 3/2 û î.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from graph.device import actuators_of
from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import RigError, RigProblem

if TYPE_CHECKING:
    from pathlib import Path

    from graph import Diagram, Winding

FULL_MODULATION = math.sqrt(3.0) / 2.0  # supply current per amplitude of the phase current
VALUE_LIMIT = 1e6  # in the unit of the value
KEYS = {  # unit, description, whether it is required
    "voltage": ("V", "nominal voltage", True),
    "capacity": ("A·h", "capacity", True),
    "full_voltage": ("V", "voltage when fully charged", False),
    "max_current": ("A", "permitted continuous current", False),
    "fuse": ("A", "fuse of each drive", False),
    "load": ("W", "computer, sensors and other constant loads", False),
}


@dataclass(frozen=True)
class Battery:
    """Battery of a rig.

    voltage, full_voltage : V; capacity : A·h; max_current, fuse : A, None if not given; load : W
    """

    voltage: float
    capacity: float
    full_voltage: float
    max_current: float | None = None
    fuse: float | None = None
    load: float = 0.0

    @property
    def energy(self) -> float:
        """Energy in W·h at the nominal voltage."""
        return self.voltage * self.capacity

    @property
    def load_current(self) -> float:
        """Current of the constant load, A."""
        return self.load / self.voltage


def parse_battery(table: Mapping[str, Any], report: Callable[[str, str], None]) -> Battery | None:
    """Return the Battery of a table of a rig file; None if it is invalid. report : callback for (message, hint)"""
    valid = True
    for key in table:
        if key not in KEYS:
            report(f"{key}: unknown key", suggestion(key, KEYS) or f"it has {', '.join(KEYS)}")
            valid = False
    for key, (unit, description, needed) in KEYS.items():
        value = table.get(key)
        if value is None:
            if needed:
                report(f"{key} is missing", f"write {key} = 24.0, its {description} in {unit}")
            valid = valid and not needed
        elif type(value) not in (int, float) or not 0.0 < value <= VALUE_LIMIT:
            report(f"{key} = {value!r}: expected a number above 0, in {unit}", f"write the {description} in {unit}")
            valid = False
    if not valid:
        return None
    if table.get("full_voltage", math.inf) < table["voltage"]:
        report("full_voltage is below voltage", "write the voltage of the fully charged battery")
        return None
    return Battery(**{"full_voltage": table["voltage"], **table})


def windings(diagram: Diagram, proved: Mapping[str, float] = MappingProxyType({})) -> dict[str, Winding]:
    """Return the Winding of each actuator, by path.

    proved : {path: N·m}, bounds of the torque that are lower than the limit of the actuator
    """
    return {block.path: _at(block.winding(), proved.get(block.path, math.inf)) for block in actuators_of(diagram)}


def _at(winding, torque):
    """Return a Winding with a lower limit, torque in N·m."""
    if winding.limit is None or winding.current is None or not 0.0 < torque < winding.limit:
        return winding
    return replace(winding, limit=torque, current=winding.current * torque / winding.limit)


def supply_current(winding: Winding) -> float | None:
    """Return the largest supply current of a drive in A; None if unknown."""
    return None if winding.current is None else FULL_MODULATION * winding.current


def continuous_current(winding: Winding) -> float | None:
    """Return the largest mean supply current in A while the RMS torque is at most the rated one; None if unknown."""
    current = supply_current(winding)
    if current is None or winding.limit is None or winding.rated is None:
        return current
    return current * min(1.0, winding.rated / winding.limit)


def require_supply(battery: Battery | None, diagram: Diagram, path: Path) -> None:
    """Raise RigError for each drive that a battery would damage: its full voltage exceeds the supply range.

    path : path of the rig file
    """
    if battery is None:
        return
    full = battery.full_voltage
    problems = [
        RigProblem(
            "TW137",
            f"[battery] of up to {full:g} V exceeds the supply range of {drive}, {winding.supply[0]:g} to "
            f"{winding.supply[1]:g} V",
            "use a battery of a lower voltage, or correct voltage and full_voltage",
        )
        for drive, winding in windings(diagram).items()
        if winding.supply and full > winding.supply[1]
    ]
    if problems:
        raise RigError(path, problems)
