"""Rigs: the real interface and device of each logical name in a diagram."""

from runtime.rig.acceptance import require_acceptance
from runtime.rig.battery import require_supply
from runtime.rig.buses import RigBuses
from runtime.rig.errors import CODES, RigError, RigProblem
from runtime.rig.file import RigFile, read
from runtime.rig.joints import require_ranges
from runtime.rig.overrides import override

__all__ = [
    "CODES",
    "RigBuses",
    "RigError",
    "RigFile",
    "RigProblem",
    "override",
    "read",
    "require_acceptance",
    "require_ranges",
    "require_supply",
]
