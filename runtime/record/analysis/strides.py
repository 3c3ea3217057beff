"""Signals over the gait cycle: start and end of strides in a recording, and a signal in each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.analysis.average_stride import STRIDE_LIMIT, STRIDE_MINIMUM, WRAP
from runtime.record.analysis.resample import at_ticks, over_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from runtime.record.analysis.trial_data import TrialData


def strides(
    trial: TrialData,
    path: str,
    events: str | Sequence[float] | np.ndarray | None = None,
    points: int = 101,
    between: tuple[str, str] | None = None,
    last: int | None = None,
) -> np.ndarray:
    """Return the result of Trial.strides, with its arguments."""
    _, shape = trial.find(path)
    return over(trial, path, bounds(trial, path, events, between, last), points).reshape(-1, points, *shape)


def over(trial: TrialData, path: str, spans: np.ndarray, points: int = 101) -> np.ndarray:
    """Return a signal over intervals, as (spans, points, elements). spans : (n, 2) array in s"""
    places, _ = trial.find(path)
    if not len(spans):
        return np.empty((0, points, len(places)))
    at = spans[:, :1] + np.linspace(0.0, 1.0, points) * (spans[:, 1:] - spans[:, :1])
    return over_times(trial, path, at.ravel()).reshape(len(spans), points, len(places))


def moment(trial: TrialData, text: str) -> float:
    """Return the time of "mark 2", "start", "end" or a number of seconds, in s. Raises BadInput."""
    if text in ("start", "end"):
        return float(trial.time[0 if text == "start" else -1]) if len(trial) else 0.0
    marks = {f"mark {event['number']}": event["tick"] for event in trial.events if event["event"] == "mark"}
    if text in marks:
        return marks[text] / trial.about["rate"]
    try:
        time = float(text)
    except (TypeError, ValueError):
        time = math.nan
    if not math.isfinite(time):
        known = f"the recording has {', '.join(marks)}" if marks else "the recording has no marks"
        raise BadInput(f"{text!r} is not a time: expected seconds, start, end or a mark; {known}")
    return time


def interval(trial: TrialData, between: tuple[str, str] | None = None) -> tuple[float, float]:
    """Return (begin, end) in s. Raises BadInput.

    between : two times for `moment`, in order; None for the whole recording
    """
    if between is None:
        return -math.inf, math.inf
    begin, end = (moment(trial, text) for text in between)
    if begin >= end:
        raise BadInput(f"between {between[0]} and {between[1]}: {begin:g} s is not before {end:g} s")
    return begin, end


def bounds(
    trial: TrialData,
    path: str,
    events: str | Sequence[float] | np.ndarray | None = None,
    between: tuple[str, str] | None = None,
    last: int | None = None,
) -> np.ndarray:
    """Return the times at which complete strides begin and end, as a (strides, 2) array in s.

    path : path of the signal
    events, between, last : as for Trial.strides
    """
    begin, end = interval(trial, between)
    walking = None
    if events is None:
        events, walking = phase_of(trial, path)
    times = beginnings(trial, events) if isinstance(events, str) else np.sort(np.asarray(events, dtype=float).ravel())
    spans = np.column_stack((times[:-1], times[1:]))
    lasting = spans[:, 1] - spans[:, 0]
    good = (lasting >= STRIDE_MINIMUM) & (lasting <= STRIDE_LIMIT)
    if not len(trial):
        return spans[:0]
    good &= (spans[:, 0] >= trial.time[0]) & (spans[:, 1] <= trial.time[-1])
    near = 0.5 / trial.about["rate"]
    walks = None if walking is None else at_ticks(trial, walking) == 1
    for index in np.flatnonzero(good):
        within = slice(*np.searchsorted(trial.time, (spans[index, 0] - near, spans[index, 1] + near)))
        good[index] = np.all(np.diff(trial.tick[within]) == 1) and (walks is None or bool(np.all(walks[within])))
    good &= (spans[:, 0] >= begin) & (spans[:, 1] <= end)
    spans = spans[good]
    return spans if last is None else spans[max(0, len(spans) - last) :]


def phase_of(trial: TrialData, path: str) -> tuple[str, str | None]:
    """Return (path of the phase, path of `walking` or None) of the innermost subsystem with a gait phase.

    Raises BadInput unless there is exactly one.
    """
    folder = around = path.rpartition("/")[0]
    phases = [name for name in trial.names if name.endswith(".phase")]
    while not (candidates := [name for name in phases if name.rpartition("/")[0] == around]) and around:
        around = around.rpartition("/")[0]
    gaits = [name for name in candidates if f"{name.removesuffix('phase')}walking" in trial.signals] or candidates
    if len(gaits) != 1:
        where = f"subsystem {folder!r}" if folder else "the recording"
        what = f"has {len(gaits)} gait phases, {', '.join(gaits)}" if gaits else "has no gait phase"
        raise BadInput(
            f"strides of {path}: {where} {what}: specify the start of strides: "
            'events="left/gait_phase.phase" (in a command line --events left/gait_phase.phase), or '
            "times in s"
        )
    walking = f"{gaits[0].removesuffix('phase')}walking"
    return gaits[0], walking if walking in trial.signals else None


def beginnings(trial: TrialData, path: str) -> np.ndarray:
    """Return the times in s at which strides begin, from a bool or a gait phase. path : path of the signal"""
    values = at_ticks(trial, path)
    if values.ndim != 1:
        raise BadInput(f"events={path!r} has {values.shape[1]} elements: strides begin with a bool or a gait phase")
    if values.dtype == bool:
        return trial.time[1:][values[1:] & ~values[:-1]]
    before, after = values[:-1].astype(float), values[1:].astype(float)
    places = np.flatnonzero(before - after > WRAP)
    rest = 1.0 - before[places]  # of the stride that ends; `after` of the next, between two samples
    share = rest / np.maximum(rest + after[places], 1e-12)
    return trial.time[places] + np.clip(share, 0.0, 1.0) * (trial.time[places + 1] - trial.time[places])
