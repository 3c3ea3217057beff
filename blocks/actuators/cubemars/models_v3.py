"""The CubeMars models of board generation V3.0, which use force control.

Wire ranges and torque constants: AKA Series Product Manual V3.0.0 and AK Series Product Manual V3.2.0, section 4.2;
those of AK40-10, AK45-10 and AK45-36: page 28 of the V3 driver software manual of 2026-09, as public notes quote it.
No manual lists AKA60-6 and AKA10-9: servo mode does not need the ranges, and force control requires them as parameters.
Ratings: the vendor's product pages; those of AK80-8 with a V3.0 board, whose motor is another than that of the V2
board, are not published. The peak of an AKH70-16 is the lower of 78 and 85 N·m, which two copies of its page have.

Two kinds of ampere: the product pages print RMS, and the manuals' constant is per ampere of amplitude (the q axis),
which is what a board commands and reports. Rated torque over constant over √2 is 0.90 to 1.09 of the rated RMS current,
0.975 on average.

Supply: "allowable working voltage range" of all three V3.0 boards, AK54-4810, AK60-4820 and AK80-4830. (AK Series
Product Manual V3.2.0, section 1.1.) The board AK48-2405 of AK40-10, AK45-10 and AK45-36: its installation manual V1.11.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from blocks.actuators.cubemars import models
from blocks.actuators.sources import ASSUMED, FIRMWARE, MANUAL, ONE, TWO, WIRES, Source, of
from graph.names import suggestion

POSITION = 12.56  # rad, half the wire range of every model
SUPPLY = (18.0, 52.0)  # V
SMALL = (
    *of((*WIRES, "torque_constant"), ONE, "V3 driver software manual of 2026-09, page 28, quoted in public notes"),
    *of(["supply"], ONE, "installation manual V1.11 of the board AK48-2405, quoted in public notes"),
    *of(["pole_pairs"], ASSUMED, "those of the motor with a V2 board"),
)
AKA_FIRMWARE = "firmware V3.2 of an AKA60-6 of 2025-02-22, disassembled"
OF_AK = "not published; that of the {} with a V3.0 board"


@dataclass(frozen=True)
class Model(models.Motor):
    """A CubeMars model with a board of generation V3.0.

    rated, peak : N·m, None if unknown
    wire_torque, wire_velocity : N·m, rad/s
    gear : reduction
    torque_constant : N·m per ampere of amplitude, at the output
    rated_rms_current, peak_rms_current : A RMS, of the product page
    supply : (lowest, highest) operating voltage in V
    ambiguous : whether the motor is also sold with boards of other generations
    """

    name: str
    rated: float | None
    peak: float | None
    wire_torque: float
    wire_velocity: float
    gear: float
    torque_constant: float
    rated_rms_current: float | None
    peak_rms_current: float | None
    pole_pairs: int
    ambiguous: bool = False
    supply: tuple[float, float] = SUPPLY
    wire_position: float = POSITION
    wire_stiffness: float = models.STIFFNESS
    wire_damping: float = models.DAMPING
    generation: int = 3
    sources: tuple[tuple[str, Source], ...] = ()

    SOURCES: ClassVar[dict[str, Source]] = {
        **dict.fromkeys(models.RATINGS, models.PAGE),
        **dict.fromkeys(
            (*WIRES, "torque_constant", "gear", "pole_pairs"),
            Source(TWO, "product manuals V3.0.0 and V3.2.0, section 4.2, as two implementations have them"),
        ),
        "supply": Source(MANUAL, "product manual V3.2.0, section 1.1"),
    }

    @property
    def motor(self) -> str:
        """Name of the motor without the generation of its board."""
        return self.name.removesuffix("-V3.0")


MODELS = {
    model.name: model
    for model in (
        #     name          rated   peak   wire torque  velocity  gear  constant  rated, peak A RMS  pole pairs
        Model("AK10-9-V3.0", 18.0, 53.0, 54.0, 28.0, 9, 1.3137, 10.7, 31.9, 21, True),
        Model("AK40-10-V3.0", 1.3, 4.1, 5.0, 45.0, 10, 0.4894, None, None, 14, True, (15.0, 28.0), sources=SMALL),
        Model("AK45-10-V3.0", 2.5, 7.0, 8.0, 20.0, 10, 1.1286, None, None, 14, True, (15.0, 28.0), sources=SMALL),
        Model("AK45-36-V3.0", 8.0, 24.0, 34.0, 6.0, 36, 3.979, None, None, 14, True, (15.0, 28.0), sources=SMALL),
        Model("AK60-6-V3.0", 3.0, 9.0, 12.0, 60.0, 6, 0.5994, 3.8, 11.2, 14, True),
        Model("AK60-39", 24.0, 72.0, 80.0, 10.0, 39, 3.4616, 4.5, 17.0, 14),
        Model("AK70-9", 8.5, 29.2, 32.0, 30.0, 9, 1.0621, 6.25, 23.8, 21),
        Model("AK80-8-V3.0", None, None, 32.0, 38.0, 8, 1.0569, None, None, 21, True),
        Model("AK80-9-V3.0", 9.0, 22.0, 18.0, 65.0, 9, 0.5701, 12.0, 28.0, 21, True),
        Model(
            "AKA10-9",
            18.0,
            53.0,
            54.0,
            28.0,
            9,
            1.44,
            10.6,
            32.0,
            14,
            sources=(
                *of(WIRES, ASSUMED, OF_AK.format("AK10-9")),
                *of(["torque_constant"], ONE, "product page, per ampere RMS: with amplitudes, at most √2 too high"),
                *of(["pole_pairs"], ONE, "product page; an AK10-9 has 21"),
            ),
        ),
        Model(
            "AKA60-6",
            3.0,
            9.0,
            12.0,
            60.0,
            6,
            0.625,
            4.0,
            11.2,
            14,
            sources=(
                *of((*WIRES[:3], "torque_constant"), FIRMWARE, AKA_FIRMWARE),
                *of(WIRES[3:], ASSUMED, OF_AK.format("AK60-6")),
            ),
        ),
        Model("AKE60-8", 5.0, 12.5, 15.0, 40.0, 8, 0.7382, 4.8, 12.0, 14),
        Model("AKE80-8", 12.0, 30.0, 35.0, 20.0, 8, 1.7909, 4.8, 12.0, 21),
        Model("AKE90-8", 55.0, 170.0, 150.0, 20.0, 8, 1.8265, 21.0, 72.0, 21),
        Model("AKH70-16", 26.0, 78.0, 110.0, 13.0, 16, 2.8334, 6.5, 19.5, 21),
        Model("AKH70-48", 74.0, 222.0, 280.0, 5.0, 48, 8.8123, 6.0, 21.0, 21),
    )
}


def find(name: str) -> Model:
    """Return a model by its name, without regard to case, hyphens, spaces or underscores.

    The name ends in '-V3.0' if the motor is also sold with other boards. Raises ValueError for a model of another
    generation, of several generations, or an unknown one.
    """
    motor, generation = models.split(name)
    for model in MODELS.values():
        if models.plain(model.motor) == motor and (
            generation.startswith("3") or not generation and not model.ambiguous
        ):
            return model
    same = next((model for model in MODELS.values() if models.plain(model.motor) == motor), None)
    older = next((full for full in models.MODELS if models.split(full)[0] == motor), None)
    if same is not None and not generation:
        raise ValueError(
            f"{same.motor} has driver boards of several generations: {models.generation_hint(same.name, older)}"
        )
    if older is not None and not generation.startswith("3"):
        raise ValueError(
            f"{name} has a board of generation V1 or V2: use CubeMars({older!r}), or "
            f"CubeMarsServo({older!r}) in servo mode"
        )
    hint = f"did you mean {same.name!r}?" if same is not None else suggestion(models.spelt(name), MODELS)
    known = f": {hint}" if hint else f"; there are {', '.join(MODELS)}"
    raise ValueError(f"{name!r} is not a CubeMars model with a table of force control{known}")


def find_in_servo_mode(name: str) -> Any:
    """Return a model by its name, with a board of any generation: all have a servo mode.

    Raises ValueError as `find` does.
    """
    motor, generation = models.split(name)
    if generation.startswith("3") or not generation and any(models.plain(only) == motor for only in models.ONLY_V3):
        return find(name)
    return models.find(name)
