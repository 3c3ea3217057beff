"""Rest periods of an IMU, in which neither rate nor acceleration changes, and their positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WINDOW_TIME = 0.5  # s
RATE_DEVIATION_LIMIT = 0.03  # rad/s, largest standard deviation of the rate at rest
ACCEL_DEVIATION_LIMIT = 0.2  # m/s², largest standard deviation of the acceleration at rest
BIAS_LIMIT = 0.4  # rad/s, largest bias; a faster constant rate is motion
BIAS_DIFFERENCE_LIMIT = 0.03  # rad/s from the median of all windows; a larger constant rate is motion
SAME_POSITION_ANGLE = 0.15  # rad, largest angle between gravity directions of one position
FACE_COSINE = np.cos(np.radians(30.0))  # smallest cosine between an axis and the vertical in one of the six positions
FACES = ("+x", "-x", "+y", "-y", "+z", "-z")


@dataclass(frozen=True)
class Rest:
    """Position at rest: mean acceleration in m/s², mean rate in rad/s and duration in s."""

    accel: np.ndarray
    gyro: np.ndarray
    seconds: float


def rests(time: np.ndarray, accel: np.ndarray, gyro: np.ndarray) -> list[Rest]:
    """Return every Rest. Repeated positions are merged.

    time : (n,) s; accel, gyro : (n, 3) m/s² and rad/s
    """
    pieces = []
    start = 0
    while start < len(time):
        end = int(np.searchsorted(time, time[start] + WINDOW_TIME - 1e-9))
        if end >= len(time):
            break
        part = slice(start, end)
        still = (
            gyro[part].std(axis=0).max() < RATE_DEVIATION_LIMIT
            and accel[part].std(axis=0).max() < ACCEL_DEVIATION_LIMIT
            and np.abs(gyro[part].mean(axis=0)).max() < BIAS_LIMIT
        )
        if still and end - start >= 5:
            pieces.append(Rest(accel[part].mean(axis=0), gyro[part].mean(axis=0), time[end] - time[start]))
        start = end
    if not pieces:
        return []
    median = np.median([piece.gyro for piece in pieces], axis=0)
    return merge_windows([piece for piece in pieces if np.abs(piece.gyro - median).max() < BIAS_DIFFERENCE_LIMIT])


def merge_windows(pieces: Sequence[Rest]) -> list[Rest]:
    """Merge windows of one position into one Rest, weighted by their durations."""
    groups = []
    for piece in pieces:
        group = next((group for group in groups if _angle(group[0].accel, piece.accel) < SAME_POSITION_ANGLE), None)
        if group is None:
            groups.append([piece])
        else:
            group.append(piece)
    merged = []
    for group in groups:
        weights = np.array([piece.seconds for piece in group])
        accel, gyro = (
            np.average([getattr(piece, name) for piece in group], axis=0, weights=weights) for name in ("accel", "gyro")
        )
        merged.append(Rest(accel, gyro, float(weights.sum())))
    return merged


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    norm = np.linalg.norm(a) * np.linalg.norm(b)
    return float(np.arccos(np.clip(a @ b / norm, -1.0, 1.0))) if norm > 0.0 else 0.0


def faces(rests: Sequence[Rest]) -> list[str]:
    """Return which of FACES pointed up, within 30°, in at least one rest. rests : list of Rest"""
    seen = set()
    for rest in rests:
        norm = np.linalg.norm(rest.accel)
        for axis in range(3):
            if norm > 0.0 and abs(rest.accel[axis]) > FACE_COSINE * norm:
                seen.add(("+" if rest.accel[axis] > 0.0 else "-") + "xyz"[axis])
    return [face for face in FACES if face in seen]
