"""Joint ranges, which a rig must give for every joint before a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph.device import actuators_of
from runtime.robot.rig.errors import RigError, RigProblem

if TYPE_CHECKING:
    from graph import Diagram
    from runtime.robot.rig.file import RigFile


def require_ranges(rig: RigFile, diagram: Diagram) -> None:
    """Raise RigError for the joints whose range neither the rig nor the diagram gives.

    rig : RigFile that has been applied to the diagram
    """
    problems = [
        _problem(block, rig)
        for block in actuators_of(diagram)
        if "position" in block.outputs and block.outputs["position"].unit == "rad" and not getattr(block, "range", ())
    ]
    if problems:
        raise RigError(rig.path, problems)


def _problem(block, rig):
    """Return the problem of a joint without a range."""
    entry = f'[device."{block.path}"]'
    if "range" not in block.hardware:
        kind = type(block).__name__
        return RigProblem(
            "TW136",
            f"{entry}: {kind} has no parameter `range`",
            f'declare range = Param((), "rad", "lowest and highest position") in {kind}, and name it in its `hardware`',
        )
    return RigProblem(
        "TW136",
        f"{entry} has no range, its lowest and highest position",
        f"write range = [LOWEST, HIGHEST] there, in rad; configure --joint {block.path} --rig {rig.path} FILE "
        "measures it with the joint moved by hand",
    )
