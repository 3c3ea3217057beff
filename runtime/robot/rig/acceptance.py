"""Caveats of torque limits and of records, each of which the operator accepts for a run on a rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import RigError, RigProblem

RECORD = "record"  # setting of a caveat on a record of commissioning

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from graph.caveats import Caveat


def require_acceptance(path: Path, caveats: Sequence[Caveat], accepted: Sequence[str]) -> None:
    """Raise RigError for each caveat that is not accepted, and BadInput for an acceptance without a caveat.

    path : path of the rig file; caveats : caveats of the schedule; accepted : names passed to --accept
    """
    names = [caveat.name for caveat in caveats]
    for name in accepted:
        if name not in names:
            hint = suggestion(name, names) or (f"to accept: {', '.join(names)}" if names else "remove it")
            raise BadInput(f"--accept {name}: nothing to accept under this name; {hint}")
    problems = [
        RigProblem(
            "TW140" if caveat.setting == RECORD else "TW138",
            f"{caveat.path}: {caveat.words}",
            f"correct it, or accept it for this run with --accept {caveat.name}",
        )
        for caveat in caveats
        if caveat.name not in accepted
    ]
    if problems:
        raise RigError(path, problems)
