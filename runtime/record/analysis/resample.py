"""Resampling of signals to other times."""

from __future__ import annotations

import copy
import os
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from runtime.host.arguments import is_number
from runtime.host.errors import BadInput

if TYPE_CHECKING:
    from typing import Any

    from runtime.record.analysis.trial_data import TrialData


QUATERNION = "quaternion"  # name of a port with a quaternion of four elements
MEMORY_FRACTION_LIMIT = 0.5  # of the rows; resampling needs the same again
UNIT = 1e-3  # tolerance of the squared norm of a unit quaternion, for rounded sensor values


T = TypeVar("T", bound="TrialData")


def resample_trial(trial: T, rate: float) -> T:
    """Return a Trial with rows at integer multiples of 1 / rate, NaN in the gaps of a damaged recording.

    rate : Hz

    Raises BadInput for an empty trial.
    """
    if not is_number(rate) or not rate or rate < 0.0:
        raise BadInput(f"resample({rate!r}): expected a rate in Hz above 0")
    if not len(trial):
        raise BadInput(f"{trial.path} has no ticks")
    near = 1e-6 / rate  # times of ticks are rounded
    first, last = np.ceil((trial.time[0] - near) * rate), np.floor((trial.time[-1] + near) * rate)
    if 8 * len(trial.signals) * (last - first + 1) > MEMORY_FRACTION_LIMIT * os.sysconf("SC_PHYS_PAGES") * os.sysconf(
        "SC_PAGE_SIZE"
    ):
        raise BadInput(
            f"resample({rate:g}): {last - first + 1:.3g} rows of {len(trial.signals)} signals do not fit "
            "into this machine's memory"
        )
    made = copy.copy(trial)
    made._recording = None
    trial.rows  # noqa: B018  # reads all signals in one pass
    made.tick = np.arange(int(first), int(last) + 1)
    made.time = made.tick / rate
    made.signals = {path: {**signal, "every": 1} for path, signal in trial.signals.items()}
    made.about = {**trial.about, "rate": float(rate), "signals": list(made.signals.values())}
    made.lateness = np.full(len(made.tick), np.nan)
    made.rows = np.empty((len(made.tick), len(trial.signals)))
    at = np.clip(made.time, trial.time[0], trial.time[-1])
    for path in trial.names:
        places, shape = trial.find(path)
        made.rows[:, places] = over_times(trial, path, at)
    for before, after in trial.gaps:
        made.rows[(made.time > before + near) & (made.time < after - near)] = np.nan
    made.frames = []
    made.events = [at_rate(event, trial.about["rate"], rate) for event in trial.events]
    return made


def over_times(trial: TrialData, path: str, at: np.ndarray) -> np.ndarray:
    """Return a signal at other times, from its samples, as (times, elements); NaN without a sample.

    at : s; before the first sample and after the last one, the signal is that sample
    """
    samples, times = trial.samples(path), trial.time_of(path)
    if not len(samples):
        return np.full((len(at), samples.shape[1]), np.nan)
    return interpolate(kind_of(trial, path), times, samples, np.clip(at, times[0], times[-1]))


def at_ticks(trial: TrialData, path: str) -> np.ndarray:
    """Return a signal over the ticks, interpolated if it was recorded at a lower rate. Type as in Trial[path]."""
    samples = trial[path]
    if trial.every(path) == 1:
        return samples
    return over_times(trial, path, trial.time).reshape(-1, *samples.shape[1:]).astype(samples.dtype)


def at_rate(event: dict[str, Any], old: float, new: float) -> dict[str, Any]:
    """Convert the tick of an event to another rate. It is fractional if it lies between the new ticks."""
    tick = event.get("tick")
    if tick is None or tick <= 0:  # -1: before the first
        return event
    at = tick * new / old
    return {**event, "tick": int(at) if at.is_integer() else at}


def kind_of(trial: TrialData, path: str) -> str | tuple[float, float]:
    """Return how a signal continues between samples.

    "held", "turning" for quaternions, "straight", or (low, high), the ends of its circle.
    """
    if trial.dtype(path) != "float":
        return "held"
    if circle := trial.row_of(path).get("circle"):
        return tuple(circle)
    if trial.find(path)[1] == (4,) and (
        path.rpartition(".")[2] == QUATERNION or trial.unit(path) == "1" and turns(trial.samples(path))
    ):
        return "turning"
    return "straight"


def turns(values: np.ndarray) -> bool:
    """Return whether four dimensionless elements are a unit quaternion in every finite sample.

    A one-hot vector of integers is not.
    """
    known = values[np.isfinite(values).all(axis=1)]
    return (
        len(known) > 0
        and bool(np.all(np.abs(np.sum(known * known, axis=1) - 1.0) < UNIT))
        and not np.all(known == np.round(known))
    )


def interpolate(kind: str | tuple[float, float], time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate values to other times; exact at samples.

    kind : as `kind_of` returns it
    values : (samples, elements) at `time`, which increases
    at : times of the result

    Returns (len(at), elements).
    """
    near = 1e-9 * (time[1] - time[0]) if len(time) > 1 else 0.0
    left = np.clip(np.searchsorted(time, at + near, side="right") - 1, 0, len(time) - 1)
    if kind == "held" or len(time) == 1:
        return values[left]
    left = np.minimum(left, len(time) - 2)
    share = ((at - time[left]) / (time[left + 1] - time[left]))[:, None]
    share = np.where(np.abs(share) < 1e-9, 0.0, np.where(np.abs(share - 1.0) < 1e-9, 1.0, share))
    before, after = values[left], values[left + 1]
    with np.errstate(invalid="ignore", over="ignore"):
        if kind == "turning":
            between = interpolate_rotation(before, after, share)
        elif isinstance(kind, str):
            between = straight(before, after, share)
        else:
            between = gone_round(before, after, share, *kind)
    return np.where(share == 0.0, before, np.where(share == 1.0, after, between))


def straight(before: np.ndarray, after: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate between two numbers without overflow. Equal numbers keep their bits."""
    return np.where(before == after, np.where(share < 0.5, before, after), (1.0 - share) * before + share * after)


def gone_round(before: np.ndarray, after: np.ndarray, share: np.ndarray, low: float, high: float) -> np.ndarray:
    """Interpolate on a circle on the shorter way; `low` and `high` are the same point."""
    turn = high - low
    way = after - before
    between = before + share * (way - turn * np.round(way / turn))
    return np.where(between < low, between + turn, np.where(between > high, between - turn, between))


def interpolate_rotation(before: np.ndarray, after: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate between two unit quaternions on the shorter way, at a constant rate. (Shoemake 1985)"""
    cosine = np.sum(before * after, axis=1, keepdims=True)
    after = np.where(cosine < 0.0, -after, after)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        arc = (np.sin((1.0 - share) * angle) * before + np.sin(share * angle) * after) / sine
    chord = before + share * (after - before)
    return np.where(sine < 1e-6, chord, arc)
