"""Commands, data and base rates of MicroStrain's sensor generations, for the emulator. Real sensors are queried.

Source: MicroStrain's data communications protocols of the 3DM-GX5-25 and the 3DM-CV7-AHRS.
"""

from __future__ import annotations

from dataclasses import dataclass

from graph.names import suggestion

BASE = (0x0101, 0x0102, 0x0103, 0x0104, 0x0106, 0x0107, 0x017E)
OLDER = (*BASE, 0x0C06, 0x0C08, 0x0C0A, 0x0C0B, 0x0C11, 0x0C30, 0x0C50, 0x0D18)
NEWER = (*BASE, 0x0C0E, 0x0C0F, 0x0C11, 0x0C30, 0x0C54, 0x0D50)
SENSOR = (0x8004, 0x8005, 0x8007, 0x8008, 0x800A, 0x800C, 0x8014, 0x8017)
FILTER = (0x8203, 0x8205, 0x8206, 0x820D, 0x820E, 0x8210, 0x8213, 0x821C)
MAGNETOMETER = (0x8006, 0x8010)


@dataclass(frozen=True)
class Model:
    """A MicroStrain model.

    name, number : of the model
    newer : whether it is of the newer generation
    base_rate : Hz, of both sets
    known : supported commands and data, each as set and descriptor in one number
    """

    name: str
    number: str
    newer: bool
    base_rate: float
    known: tuple


MODELS = {
    model.name: model
    for model in (
        Model(
            "3DM-GX5-25", "6253-4220", False, 1000.0, (*OLDER, *SENSOR, *MAGNETOMETER, 0x8011, 0x8012, *FILTER, 0x8211)
        ),
        Model("3DM-CV5-10", "6259-4220", False, 1000.0, (*OLDER, *SENSOR, 0x8012, *FILTER, 0x8211)),
        Model(
            "3DM-CV7-AHRS",
            "6286-9956",
            True,
            1000.0,
            (*NEWER, *SENSOR, *MAGNETOMETER, 0x80D3, 0x80D4, 0x80D5, *FILTER, 0x82D3, 0x82D4, 0x82D5),
        ),
    )
}


def find(name: str) -> Model:
    """Return the Model of a name. Raises ValueError for an unknown name."""
    if name not in MODELS:
        raise ValueError(suggestion(name, MODELS) or f"expected one of {', '.join(MODELS)}, got {name!r}")
    return MODELS[name]
