"""The models of the DM-J series.

The encoded ranges are the defaults in two public clients, damiao-motor 1.0.6 and lerobot 0.4.4. They are settings of
each unit, PMAX, VMAX and TMAX: arming reads them and refuses a drive with others, and `scan` prints them. The clients
differ for the VMAX of DM-J4340: 8 rad/s in lerobot and in the table of Seeed Studio, 10 in damiao-motor; the first is
used. Ratings, gear and currents of DM-J4310 and DM-J4340: the table of Seeed Studio, "Damiao 43 series". No source at
hand states those of the other models: their `limit` must be given in N·m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from blocks.actuators.sources import ASSUMED, ONE, TWO, WIRES, Source, Sourced
from graph.names import suggestion

RATINGS = ("rated", "peak", "gear", "torque_constant", "rated_current", "peak_current", "supply")


@dataclass(frozen=True)
class Model(Sourced):
    """A model. The gear of an unrated one is the last two digits of its name.

    rated, peak, wire_torque : N·m; wire_velocity : rad/s; torque_constant : N·m/A; currents : A, of a phase
    supply : (lowest, highest) operating voltage in V
    """

    name: str
    gear: float
    wire_velocity: float
    wire_torque: float
    rated: float | None = None
    peak: float | None = None
    torque_constant: float | None = None
    rated_current: float | None = None
    peak_current: float | None = None
    supply: tuple[float, ...] = ()
    wire_position: float = 12.5
    wire_stiffness: float = 500.0
    wire_damping: float = 5.0
    sources: tuple[tuple[str, Source], ...] = ()

    SOURCES: ClassVar[dict[str, Source]] = {
        **dict.fromkeys(
            WIRES,
            Source(
                TWO,
                "damiao-motor 1.0.6 and lerobot 0.4.4; arming reads those of torque, "
                "position and velocity from the drive",
            ),
        ),
        **dict.fromkeys(RATINGS, Source(ONE, "table of Seeed Studio, Damiao 43 series")),
        "wake_shift": Source(ASSUMED, "one turn of the output, where the manual states an absolute encoder"),
    }

    @property
    def wake_shift(self) -> float:
        """Step in rad by whose multiples a power cycle can shift the position: its output encoder counts one turn."""
        return 2.0 * math.pi


MODELS = {
    model.name: model
    for model in (
        #       name     gear velocity torque rated peak constant currents supply
        Model("DM-J4310", 10.0, 30.0, 10.0, 3.0, 7.0, 0.945, 3.7, 7.2, (15.0, 32.0)),
        Model("DM-J4340", 40.0, 8.0, 28.0, 9.0, 27.0, 4.074, 3.0, 8.0, (15.0, 32.0)),
        Model("DM-J6006", 6.0, 45.0, 20.0),
        Model("DM-J8006", 6.0, 45.0, 40.0),
        Model("DM-J8009", 9.0, 45.0, 54.0),
        Model("DM-J10010", 10.0, 20.0, 200.0),
        Model("DM-J10010L", 10.0, 25.0, 200.0),
    )
}


def find(name: str) -> Model:
    """Return a model by its name, without regard to case, hyphens, the letters DM-J and the ending -2EC.

    Raises ValueError with a suggestion if there is none.
    """
    plain = "".join(letter for letter in str(name).upper() if letter.isalnum()).removesuffix("2EC")
    for model in MODELS.values():
        if plain.removeprefix("DM").removeprefix("J") == model.name.removeprefix("DM-J"):
            return model
    hint = suggestion(str(name), MODELS) or f"there are {', '.join(MODELS)}"
    raise ValueError(f"{name!r} is not a Damiao model: {hint}")
