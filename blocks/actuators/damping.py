"""Bands of pure damping for the safe stop: B = min(stop_damping, limit / speed).

Damping times speed stays inside the limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cext.safety.thresholds import STOP_DAMP_ROUND
from graph import DampedStop

if TYPE_CHECKING:
    from graph.device_data import ReplyField

STEP = 1.1  # between the speeds of two bands
BAND_LIMIT = 64  # bands


def damped_stop(
    joint: Any, frames_of: Callable[[float], list[tuple[int, bool, bytes]]], velocity: ReplyField
) -> DampedStop | None:
    """Return the DampedStop of a Joint, or None if it is disabled at once.

    frames_of : function of a damping in N·m·s/rad at the joint that returns frames of at most that damping
    velocity : graph.ReplyField, or None if no reply contains the velocity
    """
    if not joint.damp_time:
        return None
    bands = bands_inside(joint.capped_limit, joint.stop_damping, joint.wire[1])
    return DampedStop(
        duration=joint.damp_time,
        bands=tuple((speed, tuple(frames_of(damping))) for speed, damping in bands),
        velocity=velocity,
        acceleration=joint.max_acceleration,
        round=STOP_DAMP_ROUND * 1e-9,
        limit=joint.capped_limit,
        transit=joint.max_transit,
    )


def bands_inside(limit: float, damping: float, top_speed: float) -> list[tuple[float, float]]:
    """Return [(highest speed, damping)] in ascending order of speed.

    The last band has an infinite speed; it is within the limit up to `top_speed`.
    """
    full = limit / damping  # speed up to which the whole damping is inside the limit
    if full >= top_speed:
        return [(math.inf, damping)]
    count = min(math.ceil(math.log(top_speed / full, STEP)), BAND_LIMIT)
    speeds = [full * (top_speed / full) ** (index / count) for index in range(count)]
    return [(speed, min(damping, limit / speed)) for speed in speeds] + [(math.inf, limit / top_speed)]
