"""Signals from which the average stride of a leg is made. A recorder opens its files without NumPy."""

from __future__ import annotations

import re
from collections.abc import Iterable

INPUTS = ("phase", "walking", "angle", "velocity", "torque")


def contact_of(names: Iterable[str], angle: str) -> str | None:
    """Return the signal of the ground contact of a leg: the only `contact` in the subsystem of its angle, or None.

    That of a block with "heel" in its name is not used: it ends before toe-off.

    names : recorded signals
    angle : the one that measures the angle of the joint
    """
    folder = angle.rpartition("/")[0]
    found = [
        name for name in names if re.fullmatch(rf"{re.escape(folder and folder + '/')}(?!.*heel).*\.contact", name)
    ]
    return found[0] if len(found) == 1 else None
