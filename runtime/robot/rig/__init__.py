"""Rigs: the real interface and device of each logical name in a diagram."""

from runtime.robot.rig.acceptance import require_acceptance
from runtime.robot.rig.battery import require_supply
from runtime.robot.rig.buses import RigBuses
from runtime.robot.rig.errors import CODES, RigError, RigProblem
from runtime.robot.rig.file import RigFile, read
from runtime.robot.rig.joints import require_ranges
from runtime.robot.rig.overrides import override

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
