"""When an IMU lay still: pieces of time in which neither rate nor acceleration changes, and the positions that they
are.
"""

from dataclasses import dataclass

import numpy as np

PIECE = 0.5  # s that are looked at together
TURNING = 0.03  # rad/s of standard deviation, above which it moves
SHAKING = 0.2  # m/s², likewise
FASTEST_BIAS = 0.4  # rad/s: what turns faster is no bias, however even it is
ALIKE = 0.03  # rad/s from the median of all, beyond which a piece is an even turn
APART = 0.15  # rad between directions of two positions that are not the same
NEAR = np.cos(np.radians(30.0))  # of an axis to the vertical, for one of the six positions
FACES = ("+x", "-x", "+y", "-y", "+z", "-z")


@dataclass(frozen=True)
class Rest:
    """One position in which it lay still: means of acceleration in m/s² and rate in rad/s, and for how long, in s."""

    accel: np.ndarray
    gyro: np.ndarray
    seconds: float


def rests(time, accel, gyro):
    """Every Rest, positions that were taken again counted once.

    time : (n,) s; accel, gyro : (n, 3) m/s² and rad/s
    """
    pieces = []
    start = 0
    while start < len(time):
        end = int(np.searchsorted(time, time[start] + PIECE - 1e-9))
        if end >= len(time):
            break
        part = slice(start, end)
        still = (
            gyro[part].std(axis=0).max() < TURNING
            and accel[part].std(axis=0).max() < SHAKING
            and np.abs(gyro[part].mean(axis=0)).max() < FASTEST_BIAS
        )
        if still and end - start >= 5:
            pieces.append(Rest(accel[part].mean(axis=0), gyro[part].mean(axis=0), time[end] - time[start]))
        start = end
    if not pieces:
        return []
    median = np.median([piece.gyro for piece in pieces], axis=0)
    return joined([piece for piece in pieces if np.abs(piece.gyro - median).max() < ALIKE])


def joined(pieces):
    """Pieces of one position as one Rest, weighed by their times."""
    groups = []
    for piece in pieces:
        group = next((group for group in groups if angle(group[0].accel, piece.accel) < APART), None)
        if group is None:
            groups.append([piece])
        else:
            group.append(piece)
    found = []
    for group in groups:
        weights = np.array([piece.seconds for piece in group])
        accel, gyro = (
            np.average([getattr(piece, name) for piece in group], axis=0, weights=weights) for name in ("accel", "gyro")
        )
        found.append(Rest(accel, gyro, float(weights.sum())))
    return found


def angle(a, b):
    norm = np.linalg.norm(a) * np.linalg.norm(b)
    return float(np.arccos(np.clip(a @ b / norm, -1.0, 1.0))) if norm > 0.0 else 0.0


def faces(found):
    """Which of the six positions were taken, as FACES names them: that axis up, within 30°."""
    seen = set()
    for rest in found:
        norm = np.linalg.norm(rest.accel)
        for axis in range(3):
            if norm > 0.0 and abs(rest.accel[axis]) > NEAR * norm:
                seen.add(("+" if rest.accel[axis] > 0.0 else "-") + "xyz"[axis])
    return [face for face in FACES if face in seen]
