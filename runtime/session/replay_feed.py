"""Input of a replay: the ticks of a recording and the frames that its buses received, in blocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cext.bus.memory_bus import BusEnd
from cext.bus.replay_bus import ReplayBus, ReplayClock
from runtime.host.errors import BadInput
from runtime.record.analysis.trial import Trial
from runtime.record.storage.batches import FRAME, Batch

FRAME_HEAD = 24  # bytes of FRAME before the struct Frame
Receive = Callable[[np.ndarray, np.ndarray, np.ndarray], None]


class Feed:
    """Clock and buses of a replay, which read the recording during the run.

    trial : Trial of the recording
    buses : names of the buses of the diagram that runs
    external_ends : statuses of runs that ended by a cause outside the recording
    receive : called with each block: rows, sent frames as bytes, and the number of rows before each of them

    clock : cext.bus.replay_bus.ReplayClock
    fault : tick of the first fault after which the run waited to be armed again, where the replay ends; None without
        one
    end : the end of the recorded run up to there: a dict with `status`, `culprit`, `tick` and `late`; {} if unknown

    Raises BadInput for a bus that is not in the recording.
    """

    def __init__(self, trial: Trial, buses: list[str], external_ends: tuple[str, ...], receive: Receive) -> None:
        self.trial = trial
        fault = next((event for event in trial.events if event["event"] == "fault"), None)
        self.fault = None if fault is None else fault["tick"]
        self.end = fault or (trial.end or {}).get("end") or {}
        self.has_last_tick = self.end.get("status", "ok") not in ("ok", *external_ends)  # its cause was recorded
        for name in buses:
            if name not in trial.about["buses"]:
                known = ", ".join(trial.about["buses"]) or "none"
                raise BadInput(f"bus {name!r} of the diagram is not in the recording, whose buses are {known}")
        self.buses = [(trial.about["buses"].index(name), name, ReplayBus()) for name in buses]
        self.batches = trial.batches()
        self.receive, self.is_over, self.tick = receive, False, -1
        first = next(self.batches)
        confirmed = next((event["drains"] for event in trial.events if event["event"] == "confirmed"), -1)
        self.clock = ReplayClock(
            self.refill, trial.about["simulated"], drained_before(first.frames, trial.about["rate"]), confirmed
        )
        self.give(first)

    def ends(self) -> list[BusEnd]:
        """Return the robot's end of each bus, in the order of the diagram's buses."""
        return [bus.host for _, _, bus in self.buses]

    def refill(self) -> bool:
        """Give the next block to the clock and the buses. Returns False at the end of the recording."""
        batch = None if self.is_over else next(self.batches, None)
        if batch is not None:
            self.give(batch)
            return True
        self.is_over = True
        if not self.has_last_tick or self.end["tick"] <= self.tick:
            return False
        self.tick = self.end["tick"]
        self.clock.give([self.tick], [round(self.end.get("late", 0.0) * 1e9)])
        return True

    def give(self, batch: Batch) -> None:
        """Give a block to the clock, the buses and the comparison."""
        rows, frames = batch.rows, batch.frames
        for index, name, bus in self.buses:
            received = frames[(frames["bus"] == index) & (frames["sent"] == 0) & (frames["drain"] > 0)]
            try:
                bus.give(payloads(received), received["drain"])
            except ValueError as error:
                raise BadInput(f"{self.trial.path} is damaged: bus {name!r}: {error}") from None
        if self.fault is not None and len(rows) and rows[-1, 0] >= self.fault:
            self.is_over = True
            rows = rows[: np.searchsorted(rows[:, 0], self.fault)]
        ticks = rows[:, 0].astype(np.int64)
        try:
            self.clock.give(ticks, np.rint(rows[:, 1] * 1e9).astype(np.int64))
        except ValueError as error:
            raise BadInput(f"{self.trial.path} is damaged: {error}") from None
        self.tick = int(ticks[-1]) if len(ticks) else self.tick
        sent = frames[frames["sent"] != 0]
        self.receive(rows, payloads(sent), sent["row"])

    def skip_rest(self) -> None:
        """Pass the rest of the recording to the comparison, after a run that ended early."""
        while self.refill():
            pass


def payloads(frames: np.ndarray) -> np.ndarray:
    """Return frames, an array of runtime.record.storage.batches.FRAME, as uint8 (n, bytes of a struct Frame)."""
    return np.ascontiguousarray(frames).view(np.uint8).reshape(len(frames), FRAME.itemsize)[:, FRAME_HEAD:]


def drained_before(frames: np.ndarray, rate: float) -> list[int]:
    """Return the times of the bus drains before tick 0, in ns from the start of the run.

    frames : array of runtime.record.storage.batches.FRAME, the first of a recording
    rate : Hz
    """
    arming = frames[frames["row"] == 0]
    times = dict(zip(arming["drain"].tolist(), arming["drained"].tolist()))
    running = frames[frames["row"] > 0][:1]
    # drain of tick 0; from there one per row
    first = int(running["drain"][0] - running["row"][0]) if len(running) else max(times, default=0)
    before: list[int] = []
    for drain in range(1, first):  # a drain without received or sent frames is not in the recording
        before.append(times.get(drain, before[-1] + round(1e9 / rate) if before else 0))
    return before
