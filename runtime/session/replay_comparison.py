"""Comparison of a replay with its recording while both continue, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from graph.budget import CLASSIC_BYTES
from runtime.record.analysis.compare import Comparer, Comparison
from runtime.robot.guardian.wires import FD

LENGTH, FLAGS, DATA = 12, 13, 16  # bytes of a struct Frame


class Side:
    """Rows and sent frames of one side that the other side has not reached."""

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []
        self.frames: list[np.ndarray] = []
        self.waiting: list[tuple[np.ndarray, np.ndarray]] = []  # frames without a later row yet
        self.row_count = self.frame_count = 0

    def add(self, rows: np.ndarray, frames: np.ndarray, before: np.ndarray) -> None:
        """Add a block. before : number of rows of this side before each of the frames"""
        self.row_count += len(rows)
        self.rows.append(rows)
        self.waiting.append((normalize_frames(frames), before))
        arrived = self.waiting
        self.waiting = []
        for block, places in arrived:  # the safe stop after the last row follows the clock
            sure = int(np.searchsorted(places, self.row_count))
            self.frames.append(block[:sure])
            self.frame_count += sure
            if sure < len(block):
                self.waiting.append((block[sure:], places[sure:]))


class ReplayComparison:
    """Comparison of the rows and sent frames of a recording and its replay.

    recorded, replayed : {path: signal} of either side, in the order of their rows

    frame : index of the first sent frame that differs; None if all are equal so far
    """

    def __init__(self, recorded: dict[str, dict], replayed: dict[str, dict]) -> None:
        self.comparer = Comparer(recorded, replayed)
        self.recorded, self.replayed = Side(), Side()
        self.frame: int | None = None
        self.frames = 0  # compared

    def add_recorded(self, rows: np.ndarray, frames: np.ndarray, before: np.ndarray) -> None:
        """Add a block of the recording: rows, sent frames, and the number of recorded rows before each of them."""
        self.recorded.add(rows, frames, before)

    def add_replayed(self, rows: np.ndarray, frames: np.ndarray, before: np.ndarray) -> None:
        """Add a block of the replay, as `add_recorded`, and compare what both sides have."""
        self.replayed.add(rows, frames, before)
        self.compare()

    def compare(self) -> None:
        """Compare what both sides have."""
        for here, there in pairs(self.recorded.rows, self.replayed.rows):
            self.comparer.add(here[:, 0].astype(np.int64), here[:, 2:], there[:, 2:])
        for here, there in pairs(self.recorded.frames, self.replayed.frames):
            differs = (here != there).any(axis=1)
            if self.frame is None and differs.any():
                self.frame = self.frames + int(np.argmax(differs))
            self.frames += len(here)

    def result(self, order: list[str]) -> Comparison:
        """Return the Comparison, at the end of both. order : paths of the signals in order of computation"""
        self.compare()
        if self.frame is None and self.recorded.frame_count != self.replayed.frame_count:
            self.frame = self.frames
        return self.comparer.result(order, self.recorded.row_count, self.replayed.row_count)


def pairs(here: list[np.ndarray], there: list[np.ndarray]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Take pairs of blocks of equal length from the starts of two lists of blocks."""
    while here and there:
        count = min(len(here[0]), len(there[0]))
        if count:
            yield here[0][:count], there[0][:count]
        for blocks in (here, there):
            blocks[0] = blocks[0][count:]
            if not len(blocks[0]):
                blocks.pop(0)


def normalize_frames(frames: np.ndarray) -> np.ndarray:
    """Return struct Frames without bits that have no effect, and without those that the bus adds: its rate switch.

    frames : uint8 array (n, bytes of a struct Frame)
    """
    frames = frames.copy()
    frames[:, FLAGS] &= FD
    frames[:, FLAGS] |= np.where(frames[:, LENGTH] > CLASSIC_BYTES, FD, 0).astype(np.uint8)
    frames[:, DATA:][np.arange(frames.shape[1] - DATA) >= frames[:, LENGTH, None]] = 0
    return frames
