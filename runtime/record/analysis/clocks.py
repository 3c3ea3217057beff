"""Clocks of other devices in a recording: offset and drift from those of the run.

A sample arrives after it was taken, by the transit time, of which the least in each second is kept. The line through
these is the clock. (Paxson, "On calibrating measurements of packet transit times", 1998)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from graph import units
from runtime.host.errors import BadInput
from runtime.record.analysis.xdf import start

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from runtime.record.analysis.trial_data import TrialData

BIN = 1.0  # s
DISORDER = 0.1  # s, by which a reading may be earlier than the one before
SLOPE_BINS = 4  # required for a slope


@dataclass(frozen=True)
class Clock:
    """Clock of a device.

    time : (ticks,) s, its reading at each tick
    offset : s, its reading at tick 0
    drift : relative slowness: it lacks this many seconds in a second of the run
    error : s, largest distance of a second's shortest transit from the line; NaN if the recording has no reading
    """

    time: np.ndarray
    offset: float
    drift: float
    error: float

    def at(self, reading: ArrayLike) -> np.ndarray:
        """Return the times in s since tick 0 of readings of the clock in s."""
        return (np.asarray(reading) - self.offset) / (1.0 - self.drift)


def clock(trial: TrialData, name: str, wrap: float = 0.0) -> Clock:
    """Return a clock of a recording, as Trial.clock does."""
    names, block = set(trial.names), name.rpartition(".")[0] or name
    if name in names and f"{block}.age" in names:
        reading = trial[name] * units.convert(1.0, trial.unit(name), "s")
        here = trial.time - trial[f"{block}.age"]
    elif f"{name}.offset" in names and f"{name}.stamp" in names:  # of LSL, whose stamps count on CLOCK_MONOTONIC
        reading, here = trial[f"{name}.stamp"] - trial[f"{name}.offset"], trial[f"{name}.stamp"] - start(trial)
    elif f"{name}.stamp" in names:
        return clock(trial, f"{name}.stamp")
    elif f"{name}.clock_drift" in names:
        drift = float(trial[f"{name}.clock_drift"][-1])
        drift /= 1.0 + drift  # from a second of the device to one of the run
        return Clock((1.0 - drift) * trial.time, 0.0, drift, float("nan"))
    else:
        raise BadInput(
            f"{name} has no recorded clock: name a block with `stamp` or `clock_drift`, or the signal of a field with "
            "the device's clock, such as teensy.t"
        )
    fresh = np.flatnonzero(np.diff(reading, prepend=np.nan) != 0.0)
    fresh = fresh[np.isfinite(reading[fresh]) & np.isfinite(here[fresh])]
    if f"{block}.received" in names:
        fresh = fresh[trial[f"{block}.received"][fresh] > 0]  # a run without a time-out starts before the first sample
    reading, here = reading[fresh], here[fresh]
    if wrap:
        reading = np.unwrap(reading, period=wrap)
    if len(reading) < 2:
        raise BadInput(f"the clock {name} has no readings")
    if (back := np.diff(reading)).min() < -DISORDER:
        raise BadInput(
            f"the clock {name} starts again at {here[back.argmin() + 1]:.2f} s: state `wrap`, the time in s after "
            "which its counter wraps, or take a part of the trial with `between` if its device restarted"
        )
    lag = here - reading
    ordered = np.lexsort((lag, here // BIN))
    least = ordered[np.flatnonzero(np.diff(here[ordered] // BIN, prepend=np.nan) != 0.0)]
    origin = here[0]
    slope = np.polyfit(here[least] - origin, lag[least], 1)[0] if len(least) >= SLOPE_BINS else 0.0
    rest = lag[least] - slope * (here[least] - origin)
    level = rest.mean() if len(least) >= SLOPE_BINS else rest.min()
    offset = slope * origin - level  # the reading at tick 0
    return Clock(offset + (1.0 - slope) * trial.time, float(offset), float(slope), float(np.abs(rest - level).max()))
