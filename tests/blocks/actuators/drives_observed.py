"""A drive of each protocol whose law is closed in the drive, with the observer that plays it. Figures from the vendors'
manuals.
"""

from blocks.actuators import CubeMars, CubeMarsV3, RobStride, RobStrideMIT
from graph import Param
from tests.blocks.actuators.observer import ForceControl, Mit, Observed, Private

AK80_9, AK10_9 = Mit(12.5, 50.0, 18.0), Mit(12.5, 50.0, 65.0)
AK10_9_V3 = ForceControl(12.56, 28.0, 54.0, gear=9, pole_pairs=21)
RS03_MIT = Mit(12.57, 20.0, 60.0, host=0xFD, rest=b"\x01\x2c", stiffness=5000.0, damping=100.0)
RS02 = Private(12.57, 44.0, 17.0)


class PrivateRanges(RobStrideMIT):
    """A drive whose MIT protocol has the ranges of the private one."""

    ranges = Param("private", "1", "ranges", dtype=str, kernel=False)


KINDS = {
    "AK80-9": (CubeMars, "AK80-9", AK80_9),
    "AK10-9": (CubeMars, "AK10-9-V2.0", AK10_9),
    "AK10-9 V3.0": (CubeMarsV3, "AK10-9-V3.0", AK10_9_V3),
    "RS03 MIT": (PrivateRanges, "RS03", RS03_MIT),
    "RS02": (RobStride, "RS02", RS02),
}
MOUNTED = {"invert": True, "offset": -0.4, "gear_ratio": 1.5}

_made = {}


def observed(name, rate=200, mounted=False, **changes):
    """A new one of that name in its first state. changes : limit, acceleration"""
    if (name, mounted) not in _made:
        _made[name, mounted] = Observed(*KINDS[name], limit="peak", **(MOUNTED if mounted else {}))
    return _made[name, mounted].again(rate, **changes)
