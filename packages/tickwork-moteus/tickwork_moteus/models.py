"""The boards. None has a rated torque: that depends on the motor, so `limit` must be given in N·m.

Voltages and currents: mjbots/moteus, docs/reference/hardware.md, "Electrical Limits". Position, velocity and torque are
32-bit numbers in fixed units (docs/protocol/registers.md), so their ranges are this driver's. The gains are settings of
each unit, servo.pid_position.kp in N·m per revolution and kd in N·m per revolution/s: `wire_stiffness` is kp / 2π, and
`wire_damping` kd / 2π.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from blocks.actuators.sources import ASSUMED, MANUAL, Source, Sourced
from graph.names import suggestion

RATINGS = ("rated", "peak", "gear", "torque_constant", "rated_current")
TURN = 2.0 * math.pi
GAINS = Source(
    ASSUMED,
    "kp = 4 N·m and kd = 0.05 N·m·s per revolution; set wire_stiffness and wire_damping to servo.pid_position.kp and "
    ".kd of the unit, divided by 2π",
)


@dataclass(frozen=True)
class Model(Sourced):
    """A board. peak_current : A, of a phase; supply : (lowest, highest) operating voltage in V"""

    name: str
    peak_current: float
    supply: tuple[float, float]
    gear: float = 1.0
    rated: float | None = None
    peak: float | None = None
    torque_constant: float | None = None
    rated_current: float | None = None
    wire_position: float = 16.0 * TURN
    wire_velocity: float = 32.0 * TURN
    wire_stiffness: float = 4.0 / TURN
    wire_damping: float = 0.05 / TURN
    wire_torque: float = 200.0
    wake_shift: float = TURN  # the encoder of the rotor counts no turns without power

    SOURCES: ClassVar[dict[str, Source]] = {
        **dict.fromkeys(("wire_position", "wire_velocity", "wire_torque"), Source(MANUAL, "registers.md, Mappings")),
        **dict.fromkeys(("wire_stiffness", "wire_damping"), GAINS),
        **dict.fromkeys(("peak_current", "supply"), Source(MANUAL, "hardware.md, Electrical Limits")),
        **dict.fromkeys(RATINGS, Source(MANUAL, "none: it is that of the motor")),
        "wake_shift": Source(ASSUMED, "one turn of the output, as of a motor without a reducer"),
    }


MODELS = {
    model.name: model
    for model in (
        Model("moteus-r4", 100.0, (10.0, 44.0)),
        Model("moteus-n1", 100.0, (10.0, 54.0)),
        Model("moteus-c1", 20.0, (10.0, 51.0)),
        Model("moteus-x1", 120.0, (10.0, 54.0)),
    )
}


def find(name: str) -> Model:
    """Return a board by its name; "n1" and "moteus-r4.11" are names too. Raises ValueError with a suggestion."""
    plain = str(name).strip().lower().removeprefix("moteus").lstrip("-_ ").partition(".")[0]
    if f"moteus-{plain}" in MODELS:
        return MODELS[f"moteus-{plain}"]
    hint = suggestion(str(name), MODELS) or f"there are {', '.join(MODELS)}"
    raise ValueError(f"{name!r} is not a moteus board: {hint}")
