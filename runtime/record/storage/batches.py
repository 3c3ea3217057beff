"""Batch: a stretch of a recording, as NumPy arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.record.storage.format import FRAME as FRAME_STRUCT

# A frame as it was recorded; its last 80 bytes are a struct Frame of cext/abi.pxd.
#   drain: number of the bus drain that returned or preceded it, from 1; 0 before the first
#   drained: time of that drain in ns since the start of the run
#   row: rows that were complete before it
#   time: ns since the start of the run; id: with the flag bits of SocketCAN; bus: index in about["buses"]
FRAME = np.dtype(
    [
        ("drain", "<i8"),
        ("drained", "<i8"),
        ("row", "<i8"),
        ("time", "<i8"),
        ("id", "<u4"),
        ("length", "u1"),
        ("flags", "u1"),
        ("bus", "u1"),
        ("sent", "u1"),
        ("data", "V64"),
    ]
)
NO_FRAMES = np.zeros(0, dtype=FRAME)


class Rows(NamedTuple):
    """Rows of a recording with some of its signals.

    tick : int64 (rows,)
    time, lateness : float64 (rows,), in s
    values : float64 (rows, signals); each signal is contiguous in memory, and NaN in rows without it
    """

    tick: np.ndarray
    time: np.ndarray
    lateness: np.ndarray
    values: np.ndarray

    @classmethod
    def empty(cls, count: int, signals: int) -> Rows:
        """Return rows that are not filled."""
        values = np.empty((signals, count)).T
        return cls(np.empty(count, dtype=np.int64), np.empty(count), np.empty(count), values)


class Batch(NamedTuple):
    """Stretch of a recording.

    rows : (ticks, 2 + signals) float64: the tick, its lateness in s, every signal
    frames : array of FRAME that were recorded between these rows, in order; the last batch has no rows, and those after
        the last row
    """

    rows: np.ndarray
    frames: np.ndarray


def payloads(frames: np.ndarray) -> list[bytes]:
    """Return the struct Frame of each frame, as [bytes]."""
    data = np.ascontiguousarray(frames).view("u1").reshape(-1, FRAME.itemsize)[:, -FRAME_STRUCT.size :]
    return [row.tobytes() for row in data]
