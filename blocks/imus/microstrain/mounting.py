"""Angles of a sensor on a vehicle, as the two generations of MicroStrain's sensors store them.

Command 0C 31 of the newer generation has roll, pitch and yaw of the sensor relative to the vehicle: they transform
vectors from the sensor's axes to the vehicle's. Command 0D 11 of the older one has the angles of the inverse rotation.
(MIP SDK 4.0, commands_3dm.h and commands_filter.h)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Matrix = list[list[float]]


def matrix(angles: Sequence[float]) -> Matrix:
    """Return the matrix of roll, pitch and yaw in rad, which are applied in the order yaw, pitch, roll."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in angles)
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def stored_angles(angles: Sequence[float], newer: bool) -> tuple[float, ...]:
    """Return the angles to store for a sensor mounted at these angles, and the reverse; all in rad."""
    if newer:
        return tuple(angles)
    r = matrix(angles)  # its inverse is its transpose
    return math.atan2(r[1][2], r[2][2]), math.asin(max(-1.0, min(1.0, 0.0 - r[0][2]))), math.atan2(r[0][1], r[0][0])


def between(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the angle in rad of the rotation from one mounting to another."""
    one, other = matrix(a), matrix(b)
    trace = sum(one[i][j] * other[i][j] for i in range(3) for j in range(3))
    return math.acos(max(-1.0, min(1.0, 0.5 * (trace - 1.0))))
