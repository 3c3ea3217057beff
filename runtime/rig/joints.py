"""What a rig has to say of every joint before it is run: how far it moves."""

from graph import Actuator
from runtime.rig.errors import RigError, Trouble


def require_ranges(rig, diagram):
    """RigError naming every joint of a diagram whose range neither the rig nor the diagram gives.

    rig : RigFile, whose values the diagram has taken over
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
        return Trouble(
            "TW136",
            f"{entry}: {kind} has no parameter `range`",
            f'declare range = Param((), "rad", "lowest and highest angle of the joint") in {kind}, and '
            "name it in its `hardware`",
        )
    return Trouble(
        "TW136",
        f"{entry} has no range, the lowest and the highest angle that the joint reaches",
        f"write range = [LOWEST, HIGHEST] there, in rad; configure --joint {block.path} --rig {rig.path} FILE "
        "measures it with the joint moved by hand",
    )
