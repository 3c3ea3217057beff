"""Angle of a joint behind its drive: direction, zero, mechanical range, and what a power cycle leaves uncertain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from typing import Any

from graph import Param


class Pose:
    """Parameters of the angle that a drive reports."""

    invert = Param(False, "1", "whether the joint turns opposite to the motor", fixed=True)
    offset = Param(
        0.0,
        "rad",
        "motor position at the zero of the joint, in the units and direction of the joint",
        min=-12.5,
        max=12.5,
        fixed=True,
    )
    range = Param(
        (), "rad", "(lowest, highest) angle of the joint's mechanical range; beyond it the run ends. () if unknown"
    )
    wake_shift = Param(
        None,
        "rad",
        "angle by a multiple of which a power cycle can shift the reading of the joint; the model's by default, 0 if "
        "this unit was verified to keep its reading",
        dtype=float,
        min=0.0,
        fixed=True,
        kernel=False,
    )
    known_pose = Param(
        (), "rad", "(angle, tolerance) of the pose in which the operator holds the joint during arming; () for none"
    )
    reference = Param(
        "",
        "1",
        "output of another device that measures the same angle, such as 'left/encoder.angle', compared during arming",
        dtype=str,
    )

    spec: Any
    gear_ratio: Any

    def check_pose(self) -> None:
        """Set `shift`, rad by which a power cycle can shift the reading of the joint, and check `known_pose`."""
        self.shift = self.spec.wake_shift / self.gear_ratio if self.wake_shift is None else self.wake_shift
        self.known_pose = pose_of(self.known_pose, self.shift)


def pose_of(pose: Sequence[float], shift: float) -> tuple[float, ...]:
    """Return (angle, tolerance) of the parameter `known_pose`, () for none. Raises ValueError."""
    if not isinstance(pose, (tuple, list)) or len(pose) not in (0, 2):
        raise ValueError(f"known_pose must be an angle and a tolerance in rad, as in [0.0, 0.1], got {pose!r}")
    if not all(not isinstance(x, bool) and isinstance(x, Real) and math.isfinite(x) for x in pose):
        raise ValueError(f"known_pose must be an angle and a tolerance in rad, got {pose!r}")
    if pose and not (0.0 < pose[1] and (shift == 0.0 or pose[1] < shift / 2.0)):
        raise ValueError(
            f"the tolerance of known_pose must be above 0 and below {shift / 2.0:.4g} rad, half the shift of a power "
            f"cycle, got {pose[1]:g}"
        )
    return tuple(map(float, pose))


def motion_of(limits: Sequence[float], reach: float) -> tuple[float, ...]:
    """Return (lowest, highest) of the parameter `range`, () if unknown. Raises ValueError.

    reach : largest angle of the joint that the drive can report, in rad
    """
    if not isinstance(limits, (tuple, list)) or len(limits) not in (0, 2):
        raise ValueError(f"range must be the lowest and the highest angle in rad, as in [-0.1, 2.0], got {limits!r}")
    finite = all(not isinstance(x, bool) and isinstance(x, Real) and math.isfinite(x) for x in limits)
    if not finite or (limits and not limits[0] < limits[1]):
        raise ValueError(f"range must be the lowest and the highest angle in rad, in this order, got {limits!r}")
    if limits and max(-limits[0], limits[1]) > reach:
        degrees = ", ".join(f"{math.radians(x):.4g}" for x in limits)
        raise ValueError(
            f"range must be within ±{reach:.4g} rad, the positions that the drive reports, got {limits!r}: if these "
            f"are degrees, write [{degrees}]"
        )
    return tuple(map(float, limits))
