"""The RobStride models and the CyberGear, which share one protocol with different ranges.

Three different torques:
    rated   continuous torque
    peak    torque for seconds
    wire    value of the largest code: a scale, not a rating

RobStride user manuals of 2026-04-28; CyberGear manual. Where sources disagree the manual's tables of codes hold: its
text has positions of ± 4π rad, its code of ± 12.57; and stiffness and damping of RS03, RS04 and RS06 reach 5000 and
100, not 500 and 5. The ranges are those of the private protocol, section 4; blocks.actuators.robstride.mit has those of
the MIT protocol, section 6, which differ for three models. RS10P: manual of 2026-09-07 and series specification of
2026-09-17, as public tables quote them; the manual's constant of 7.73 N·m/A contradicts its rated current, that of the
specification, 3.73, does not.

The rated torque holds on the heat sink that section 1.2 states, of aluminium, while the drive turns; on a smaller one,
and at a standstill, where one phase carries the current, it is lower. The specification of 2026-09 has other ratings
for some models (RS01, RS02: 7 N·m; RS03: 21; RS05: 1.8); the manuals' are used.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import ClassVar

from blocks.actuators.sources import ASSUMED, MANUAL, ONE, TWO, WIRES, RangeSet, Source, Sourced, of
from graph.interval import Interval
from graph.names import suggestion

TEMPERATURE = Interval(-32768 * 0.1, 32767 * 0.1)  # °C, range of the feedback, rounded as the kernels round
NUMBERS = ("rated", "peak", "gear", "torque_constant", "rated_current", "peak_current", "no_load", "too_hot", "supply")
RS10P = of((*WIRES, *NUMBERS), ONE, "manual of 2026-09-07 and specification of 2026-09-17, quoted in public tables")


@dataclass(frozen=True)
class Model(Sourced):
    """A RobStride model or the CyberGear.

    rated, peak, wire_torque : N·m
    wire_velocity, wire_stiffness, wire_damping : rad/s, N·m/rad, N·m·s/rad
    gear : reduction
    rms_constant : N·m per A RMS
    rated_current, peak_current : A, amplitude (the manual's A pk)
    no_load : speed without load in revolutions per minute
    too_hot : temperature in °C
    supply : (lowest, highest) operating voltage in V
    """

    name: str
    rated: float
    peak: float
    wire_torque: float
    wire_velocity: float
    wire_stiffness: float
    wire_damping: float
    gear: float
    rms_constant: float
    rated_current: float
    peak_current: float
    no_load: float
    too_hot: float
    supply: tuple[float, float]
    wire_position: float = 12.57  # rad
    own_timeout: bool = True  # whether the drive can stop itself when it receives nothing
    sources: tuple[tuple[str, Source], ...] = ()
    range_sets: tuple[RangeSet, ...] = ()

    SOURCES: ClassVar[dict[str, Source]] = {
        **dict.fromkeys(WIRES, Source(TWO, "user manual of 2026-04-28, section 4; three other programs agree")),
        **dict.fromkeys(NUMBERS, Source(MANUAL, "user manual of 2026-04-28, section 1")),
        "wake_shift": Source(ASSUMED, "one turn of the motor: no manual states the side of the gear"),
    }

    @property
    def heat_sink(self) -> str:
        """Plate of aluminium on which the rated torque holds, mm; "" if no source states it."""
        return HEAT_SINKS.get(self.name, "")

    @property
    def torque_constant(self) -> float:
        """Torque constant in N·m/A at the output, per ampere of amplitude, as the drive commands and limits it."""
        return self.rms_constant / math.sqrt(2.0)

    @property
    def wake_shift(self) -> float:
        """Step in rad by whose multiples a power cycle can shift the position at the output.

        It is one turn of the motor, if the encoder is on its side of the gear. Assumed, not verified: according to the
        manual's `zero_sta`, the position at the start is within one turn, on an unspecified side of the gear.
        """
        return 2.0 * math.pi / self.gear

    @property
    def is_cybergear(self) -> bool:
        """Whether it is a CyberGear, whose frames differ."""
        return self.name == "CyberGear"


MODELS = {
    model.name: model
    for model in (
        #     name   rated  peak  wire torque  velocity  stiffness  damping  gear  constant  currents  rpm  too hot  V
        Model("RS00", 5.0, 14.0, 14.0, 33.0, 500.0, 5.0, 10.0, 1.48, 4.7, 15.5, 315.0, 145.0, (24, 60)),
        Model("RS01", 6.0, 17.0, 17.0, 44.0, 500.0, 5.0, 7.75, 1.22, 7.0, 23.0, 315.0, 145.0, (24, 50)),
        Model("RS02", 6.0, 17.0, 17.0, 44.0, 500.0, 5.0, 7.75, 1.22, 7.0, 23.0, 410.0, 135.0, (24, 60)),
        Model("RS03", 20.0, 60.0, 60.0, 20.0, 5000.0, 100.0, 9.0, 2.36, 13.0, 43.0, 200.0, 145.0, (24, 60)),
        Model("RS04", 40.0, 120.0, 120.0, 15.0, 5000.0, 100.0, 9.0, 2.1, 27.0, 90.0, 200.0, 145.0, (24, 60)),
        Model("RS05", 1.6, 5.5, 5.5, 50.0, 500.0, 5.0, 7.75, 0.94, 2.4, 11.0, 480.0, 135.0, (15, 60)),
        Model("RS06", 11.0, 36.0, 36.0, 50.0, 5000.0, 100.0, 9.0, 1.09, 14.3, 57.0, 480.0, 145.0, (15, 60)),
        Model("EL05", 1.8, 6.0, 6.0, 50.0, 500.0, 5.0, 9.0, 0.94, 2.6, 11.0, 430.0, 135.0, (15, 60)),
        Model(
            "RS10P", 14.0, 42.0, 42.0, 13.0, 500.0, 5.0, 25.0, 3.73, 5.3, 19.0, 125.0, 135.0, (15, 60), sources=RS10P
        ),
        Model(
            "CyberGear",
            4.0,
            12.0,
            12.0,
            30.0,
            500.0,
            5.0,
            7.75,
            0.87,
            6.5,
            23.0,
            296.0,
            80.0,
            (16, 28),
            wire_position=12.5,
            own_timeout=False,
            sources=of(NUMBERS, MANUAL, "CyberGear manual"),
        ),
    )
}

# Plate of aluminium of the rated torque, mm. (User manuals, section 1.2.)
HEAT_SINKS = {
    "RS00": "90 × 85",
    "RS01": "260 × 280",
    "RS02": "260 × 280",
    "RS03": "215 × 220",
    "RS04": "345 × 345; 35 N·m on 220 × 200",
    "RS05": "70 × 70",
    "RS06": "130 × 160",
    "EL05": "70 × 70",
    "RS10P": "210 × 210; 10 N·m at a standstill",
}

# The oldest firmware that reads and writes parameters in MIT mode, and with it the time-out. (RobStride user manuals of
# 2026-04-28, section 6.)
MIT_FIRMWARE = {
    "RS00": "0.0.3.27",
    "RS01": "0.1.3.14",
    "RS02": "0.2.3.32",
    "RS03": "0.3.1.41",
    "RS04": "0.4.1.29",
    "RS05": "0.5.0.13",
    "RS06": "0.6.0.11",
    "EL05": "1.0.5.0.4",
}

# Names of the vendor's shops and of papers for the same motors.
# An RS02-IP67 has the numbers of an RS02 in its own manual of 2026-04-28, and another housing.
ALSO = {
    "EduLite05": "EL05",
    **{f"RobStride{name[2:]}": name for name in MODELS if name.startswith("RS")},
    "RS02-IP67": "RS02",
    "RobStride02IP67": "RS02",
}


def find(name: str) -> Model:
    """Return a model by its name, without regard to case, hyphens, spaces or underscores.

    Raises ValueError with a suggestion if there is none.
    """
    wanted = re.sub(r"(?<=GEAR)(MICRO)?MOTOR$", "", re.sub(r"^(XIAOMI|ROBSTRIDE)(?=\D)", "", _plain(name)))
    for spelling, full in ({full: full for full in MODELS} | ALSO).items():
        if _plain(spelling) == wanted:
            return MODELS[full]
    known = {_plain(spelling): spelling for spelling in (*MODELS, *ALSO)}
    close = suggestion(wanted, known)
    hint = f": did you mean {known[close.split(chr(39))[1]]!r}?" if close else f"; there are {', '.join(MODELS)}"
    raise ValueError(f"{name!r} is not a RobStride model{hint}")


def _plain(name: str) -> str:
    return "".join(letter for letter in str(name).upper() if letter.isalnum())
