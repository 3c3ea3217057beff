"""Parameters of RobStride drives and of the CyberGear, by name, read with type 17 and written with type 18.

RobStride user manuals of 2026-04-28, section 4.1.14; CyberGear manual, section 4.1.12. Written values are lost at
power-off unless they are saved, which only a RobStride can do.
"""

from __future__ import annotations

import struct

from msgspec import Struct

from blocks.actuators.robstride.frames import WHOLE, WHOLE_OF_CYBERGEAR
from graph.names import suggestion


class Parameter(Struct, frozen=True):
    """Parameter of a drive. writable : whether `configure` can write it; cybergear : whether the CyberGear has it"""

    index: int
    name: str
    unit: str
    meaning: str
    writable: bool = True
    cybergear: bool = False

    def layout(self, is_cybergear: bool = False) -> str:
        """Return the struct format of its value."""
        layouts = WHOLE | WHOLE_OF_CYBERGEAR if is_cybergear else WHOLE
        return layouts.get(self.index, "<f")

    def is_whole(self, is_cybergear: bool = False) -> bool:
        """Return whether its value is an integer."""
        return self.layout(is_cybergear) != "<f"

    def value_of(self, data: bytes, is_cybergear: bool = False) -> float:
        """Return the number in the eight bytes of a reply."""
        return struct.unpack_from(self.layout(is_cybergear), data, 4)[0]

    def text(self, value: float) -> str:
        """Return a value with its unit as text."""
        return f"{value:.6g}" + (f" {self.unit}" if self.unit != "1" else "")


PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter(0x7005, "run_mode", "1", "0 operation, 1 position, 2 velocity, 3 current, 5 csp", cybergear=True),
        Parameter(0x7006, "iq_ref", "A", "current command", writable=False, cybergear=True),
        Parameter(0x700A, "spd_ref", "rad/s", "velocity command", writable=False, cybergear=True),
        Parameter(0x700B, "limit_torque", "N·m", "torque limit", cybergear=True),
        Parameter(0x7010, "cur_kp", "1", "proportional gain of the current loop", cybergear=True),
        Parameter(0x7011, "cur_ki", "1", "integral gain of the current loop", cybergear=True),
        Parameter(0x7014, "cur_filt_gain", "1", "filter coefficient of the current, 0 to 1", cybergear=True),
        Parameter(0x7016, "loc_ref", "rad", "position command", writable=False, cybergear=True),
        Parameter(0x7017, "limit_spd", "rad/s", "velocity limit in the mode csp", cybergear=True),
        Parameter(0x7018, "limit_cur", "A", "current limit in the position and velocity modes", cybergear=True),
        Parameter(0x7019, "mechPos", "rad", "position", writable=False, cybergear=True),
        Parameter(0x701A, "iqf", "A", "filtered current", writable=False, cybergear=True),
        Parameter(0x701B, "mechVel", "rad/s", "velocity", writable=False, cybergear=True),
        Parameter(0x701C, "VBUS", "V", "supply voltage", writable=False, cybergear=True),
        Parameter(0x701D, "rotation", "1", "number of turns", writable=False, cybergear=True),
        Parameter(0x701E, "loc_kp", "1/s", "gain of the position loop", cybergear=True),
        Parameter(0x701F, "spd_kp", "1", "proportional gain of the velocity loop", cybergear=True),
        Parameter(0x7020, "spd_ki", "1", "integral gain of the velocity loop", cybergear=True),
        Parameter(0x7021, "spd_filt_gain", "1", "filter coefficient of the velocity, 0 to 1"),
        Parameter(0x7022, "acc_rad", "rad/s²", "acceleration in the velocity mode"),
        Parameter(0x7024, "vel_max", "rad/s", "velocity limit in the mode position (PP)"),
        Parameter(0x7025, "acc_set", "rad/s²", "acceleration in the mode position (PP)"),
        Parameter(0x7026, "EPScan_time", "1", "report period: 1 is 10 ms, each further 1 adds 5 ms"),
        Parameter(
            0x7028, "canTimeout", "1", "time without a command after which the drive stops: 20000 is 1 s, 0 never"
        ),
        Parameter(0x7029, "zero_sta", "1", "position range at power-on: 0 is 0 to 2π, 1 is −π to π"),
        Parameter(0x702B, "add_offset", "rad", "offset of the zero position"),
    )
}


def find(name: str) -> Parameter:
    """Return the Parameter of a name. Raises ValueError with a suggestion for an unknown name."""
    for known, parameter in PARAMETERS.items():
        if known.lower() == name.lower():
            return parameter
    hint = suggestion(name, PARAMETERS)
    raise ValueError(f"unknown parameter {name!r}; " + (hint or f"expected one of {', '.join(PARAMETERS)}"))
