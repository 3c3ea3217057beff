"""Joint ranges, which a rig must give for every joint before a run."""

from graph import Actuator
from runtime.rig.errors import RigError, RigProblem


def require_ranges(rig, diagram):
    """Raise RigError for the joints whose range neither the rig nor the diagram gives.

    rig : RigFile that has been applied to the diagram
    """
    troubles = [
        missing(block, rig)
        for block in diagram
        if isinstance(block, Actuator)
        and "position" in block.outputs
        and block.outputs["position"].unit == "rad"
        and not getattr(block, "range", ())
    ]
    if troubles:
        raise RigError(rig.path, troubles)


def missing(block, rig):
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
