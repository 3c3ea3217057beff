"""The CubeMars AK models of board generations V1 and V2, which use MIT mode.

Three different torques:
    rated   continuous torque
    peak    torque for seconds
    wire    value of the largest code: a scale, not a rating

Wire ranges: AK Series Module Driver Manual V1.0.18 (2026-01-19), page 66; V1.0.15 and V1.0.8 agree where they list a
model. The MIT firmware of an AK40-10 of 2025-06-24 has ±12.56 rad and ±45 rad/s, where the manual has ±12.5 rad and
±45.5 rad/s: `ranges` selects between them. Ratings and torque constants: the vendor's product pages. Their amperes are
taken for RMS, as those of boards V3.0 are (models_v3), and the constants are per such an ampere: rated torque over
constant is 0.79 to 1.01 of the rated current. A drive in servo mode commands and reports the amplitude. The constant of
an AK80-6 is not published: that of an AK80-9 is assumed, which also has 100 rpm/V and 21 pole pairs; rated torque over
it is 0.98 of the rated current.

Supply: the same manual, "allowable working voltage" of the board: 18 to 52 V of V2.1, 18 to 28 V of V2.2. The board
follows from the rated voltage of the product page: V2.1 for 48 V or 24/48 V, V2.2 for 24 V. No source states the range
of the mini board, also of 24 V: that of V2.2 is assumed.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import ClassVar

from blocks.actuators.sources import ASSUMED, FIRMWARE, MANUAL, ONE, TWO, WIRES, RangeSet, Source, Sourced, of
from graph.names import suggestion

POSITION = 12.5  # rad, half the wire range of every model
STIFFNESS = 500.0  # N·m/rad, from 0
DAMPING = 5.0  # N·m·s/rad, from 0
V2_1, V2_2 = (18.0, 52.0), (18.0, 28.0)  # V, supply of the boards
NO_BOARD = "no source states the range of its board: that of another board with the same rated voltage is assumed"
MINI = of(["supply"], ASSUMED, NO_BOARD)
RATINGS = ("rated", "peak", "gear", "torque_constant", "rated_current", "peak_current", "pole_pairs")
PAGE = Source(ONE, "the vendor's product page")
AK40_10_FIRMWARE = "MIT firmware of 2025-06-24, disassembled; the manual differs by 0.5 and 1.1 %"


class Motor(Sourced):
    """Quantities that follow from the columns of a model with any board."""

    rated_rms_current: float | None
    peak_rms_current: float | None
    gear: float

    @property
    def supply_note(self) -> str:
        """Reason why the supply is assumed, "" if it is published."""
        return self.assumed("supply").get("supply", "")

    @property
    def rated_current(self) -> float | None:
        """Rated current in A, as amplitude; None if unknown."""
        return None if self.rated_rms_current is None else math.sqrt(2.0) * self.rated_rms_current

    @property
    def peak_current(self) -> float | None:
        """Peak current in A, as amplitude; None if unknown."""
        return None if self.peak_rms_current is None else math.sqrt(2.0) * self.peak_rms_current

    @property
    def wake_shift(self) -> float:
        """Step in rad by whose multiples a power cycle can shift the position at the output.

        It is one turn of the motor, as its encoder counts one turn.
        """
        return 2.0 * math.pi / self.gear


@dataclass(frozen=True)
class Model(Motor):
    """A CubeMars model with a board of generation V1 or V2. The other wire ranges are the same for all.

    rated, peak : N·m
    wire_torque, wire_velocity : N·m, rad/s
    gear : reduction
    rated_rms_current, peak_rms_current : A RMS, of the product page
    supply : (lowest, highest) operating voltage of the board in V
    errors : "code", or "mask" of a firmware whose error byte is a mask of bits
    """

    name: str
    rated: float
    peak: float
    wire_torque: float
    wire_velocity: float
    gear: float
    motor_constant: float  # N·m/A, of the product page's RMS amperes
    rated_rms_current: float | None
    peak_rms_current: float | None
    pole_pairs: int
    supply: tuple[float, float]
    wire_position: float = POSITION
    wire_stiffness: float = STIFFNESS
    wire_damping: float = DAMPING
    generation: int = 2
    errors: str = "code"  # meaning of the error byte in MIT mode
    sources: tuple[tuple[str, Source], ...] = ()
    range_sets: tuple[RangeSet, ...] = ()

    SOURCES: ClassVar[dict[str, Source]] = {
        **dict.fromkeys(WIRES, Source(TWO, "driver manual V1.0.18, page 66; the C driver of leggedrobotics agrees")),
        **dict.fromkeys(RATINGS, PAGE),
        "supply": Source(MANUAL, "driver manual V1.0.18, of the board that follows from the product page's voltage"),
    }

    @property
    def torque_constant(self) -> float:
        """Torque constant in N·m/A at the output.

        Used with amplitudes, in servo mode, it gives at most √2 times the torque.
        """
        return self.motor_constant * self.gear


MODELS = {
    model.name: model
    for model in (
        #     name           rated   peak   wire torque  velocity  gear  constant  rated, peak A RMS  pole pairs  supply
        Model("AK10-9-V2.0", 18.0, 48.0, 65.0, 50.0, 9, 0.198, 10.6, 29.8, 21, V2_1),
        Model(
            "AK40-10",
            1.3,
            4.1,
            5.0,
            45.0,
            10,
            0.056,
            2.7,
            7.3,
            14,
            V2_2,
            wire_position=12.56,
            errors="mask",
            sources=(*of(WIRES, FIRMWARE, AK40_10_FIRMWARE), *MINI),
            range_sets=(
                RangeSet("firmware", (12.56, 45.0, STIFFNESS, DAMPING, 5.0), Source(FIRMWARE, AK40_10_FIRMWARE)),
                RangeSet("manual", (12.5, 45.5, STIFFNESS, DAMPING, 5.0), Source(MANUAL, "driver manual V1.0.18")),
            ),
        ),
        Model("AK45-10", 2.5, 7.0, 8.0, 20.0, 10, 0.127, 2.1, 5.0, 14, V2_2, sources=MINI),
        Model("AK45-36", 8.0, 24.0, 34.0, 6.0, 36, 0.11, 2.0, 6.5, 14, V2_2, sources=MINI),
        Model("AK60-6-V1.1", 3.0, 9.0, 15.0, 45.0, 6, 0.078, 6.5, 22.7, 14, V2_2),
        Model("AK70-10", 8.3, 24.8, 25.0, 50.0, 10, 0.123, 7.2, 23.2, 21, V2_1),
        Model(
            "AK80-6",
            6.0,
            12.0,
            12.0,
            76.0,
            6,
            0.105,
            9.7,
            20.0,
            21,
            V2_1,
            sources=of(["torque_constant"], ASSUMED, "not published; that of an AK80-9, with the same rpm/V and poles"),
        ),
        Model("AK80-8", 10.0, 25.0, 32.0, 37.5, 8, 0.199, 6.9, 21.0, 21, V2_1),
        Model("AK80-9", 9.0, 18.0, 18.0, 50.0, 9, 0.105, 10.3, 22.3, 21, V2_1),
        Model("AK80-64", 48.0, 120.0, 144.0, 8.0, 64, 0.136, 7.0, 19.0, 21, V2_1),
    )
}

# names of several generations of one motor, whose boards have different protocols
AMBIGUOUS = {"AK10-9": "AK10-9-V2.0", "AK60-6": "AK60-6-V1.1"}

SYNONYMS = {"AK80-9-V2.0": "AK80-9"}  # names in the literature that state the generation of the board

# Motors that are sold with a V3 board only. (CubeMars AKA Product Manual V3.0.0.)
ONLY_V3 = ("AK60-39", "AK70-9", "AKA10-9", "AKA60-6", "AKE60-8", "AKE80-8", "AKE90-8", "AKH70-16", "AKH70-48")

MISPRINTED = {"AK80-80": "AK80-64"}  # in the driver manual V1.0.8


def find(name: str) -> Model:
    """Return a model by its name, without regard to case, hyphens, spaces or underscores.

    Raises ValueError with a suggestion if there is none.
    """
    wanted = plain(without_vendor(name))
    names = {plain(each): each for each in MODELS} | {plain(each): full for each, full in SYNONYMS.items()}
    if wanted in names:
        return MODELS[names[wanted]]
    motor, generation = split(name)
    same = [
        full for each, full in names.items() if generation in ("1", "2") and each.startswith(f"{motor}V{generation}")
    ]
    if len(same) == 1:  # the only board of that generation: V2 is V2.0
        return MODELS[same[0]]
    if generation.startswith("3") or any(plain(only) == motor for only in ONLY_V3):
        raise ValueError(
            f"{name} has a V3.0 board, whose protocol differs from V1 and V2: use CubeMarsV3, or "
            "CubeMarsServo in servo mode"
        )
    for short, full in AMBIGUOUS.items():
        if plain(short) == wanted:
            raise ValueError(
                f"{short} has driver boards of several generations: {generation_hint(short + '-V3.0', full)}"
            )
    hint = _same_motor(motor) or suggestion(spelt(name), MODELS)
    known = f": {hint}" if hint else f"; there are {', '.join(MODELS)}"
    raise ValueError(f"{name!r} is not a CubeMars model with a MIT-mode table{known}")


def generation_hint(newest: str, older: str | None) -> str:
    """Return the text on how to identify the board of a motor and which block to use."""
    return (
        f"see the motor's label; a V3.0 board reports in extended frames. Use CubeMarsV3({newest!r}) "
        "for V3.0 in force "
        f"control, CubeMars({older!r}) for V1 and V2 in MIT mode, and CubeMarsServo with either name for servo mode"
    )


def _same_motor(motor: str) -> str:
    """Return the suggestion for a motor with another known name, or "".

    A similar spelling may be a motor of another size.
    """
    for printed, full in MISPRINTED.items():
        if plain(printed) == motor:
            return f"{printed} is a misprint in the manual for {full!r}"
    return next((f"did you mean {full!r}?" for full in MODELS if split(full)[0] == motor), "")


def split(name: str) -> tuple[str, str]:
    """'AK80-9 V3.0' gives ('AK809', '3.0'): the motor, and the generation of its board, '' where the name has none."""
    name = without_vendor(name)
    match = re.match(r"(.*?)[\s_-]*V[\s_.-]*([\d.]+)$", name.strip().upper())
    return (plain(match[1]), match[2]) if match else (plain(name), "")


def without_vendor(name: str) -> str:
    """Return a name without the vendor's and brackets: 'CubeMars AK80-9 (V3)' gives 'AK80-9 V3'."""
    open_name = re.sub(r"[()\[\]]", "", str(name))
    return re.sub(r"^\s*(cube\s*mars|t[\s_-]?motor)[\s_-]*(?=\w)", "", open_name, flags=re.IGNORECASE)


def spelt(name: str) -> str:
    """A name as the tables write it, to compare the two."""
    return str(name).upper().replace("_", "-").replace(" ", "-")


def plain(name: str) -> str:
    """Return a model name in upper case, without separators."""
    return "".join(letter for letter in str(name).upper() if letter.isalnum())
