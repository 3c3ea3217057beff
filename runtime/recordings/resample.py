"""Signals at other times than they were recorded at."""

import copy

import numpy as np

from runtime.errors import BadInput

QUATERNION = "quaternion"       # what a port is called whose four elements are one


def resampled(trial, rate):
    """A Trial like this one, with rows at whole multiples of 1 / rate. rate : Hz. BadInput where it holds no tick."""
    if not rate > 0.0 or not np.isfinite(rate):
        raise BadInput(f"resample({rate!r}): expected a rate in Hz above 0")
    if not len(trial):
        raise BadInput(f"{trial.path} holds no tick")
    near = 1e-6 / rate                          # times of ticks are rounded
    first, last = np.ceil((trial.time[0] - near) * rate), np.floor((trial.time[-1] + near) * rate)
    made = copy.copy(trial)
    made.tick = np.arange(int(first), int(last) + 1)
    made.time = made.tick / rate
    made.about = {**trial.about, "rate": float(rate)}
    made.lateness = np.full(len(made.tick), np.nan)
    made.rows = np.empty((len(made.tick), len(trial.signals)))
    at = np.clip(made.time, trial.time[0], trial.time[-1])
    for path in trial.names:
        places, shape = trial.find(path)
        made.rows[:, places] = interpolate(kind_of(trial, path), trial.time, trial.rows[:, places], at)
    made.frames = []
    return made


def kind_of(trial, path):
    """How a signal goes on between its samples: "held", "turning", "straight", or round between the two ends of its circle, (low, high)."""
    if trial.dtype(path) != "float":
        return "held"
    if circle := trial.row_of(path).get("circle"):
        return tuple(circle)
    return "turning" if trial.find(path)[1] == (4,) and path.rpartition(".")[2] == QUATERNION else "straight"


def interpolate(kind, time, values, at):
    """values : (samples, elements) at `time`, which increases. Returns (len(at), elements); exact where a sample stands."""
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
            between = turned(before, after, share)
        elif kind == "straight":
            between = before + share * (after - before)
        else:
            between = gone_round(before, after, share, *kind)
    return np.where(share == 0.0, before, np.where(share == 1.0, after, between))


def gone_round(before, after, share, low, high):
    """Between two places on a circle on the shorter way; `low` and `high` are one place."""
    turn = high - low
    way = after - before
    between = before + share * (way - turn * np.round(way / turn))
    return np.where(between < low, between + turn, np.where(between > high, between - turn, between))


def turned(before, after, share):
    """Between two unit quaternions on the shorter way, at a constant rate. (Shoemake 1985)"""
    cosine = np.sum(before * after, axis=1, keepdims=True)
    after = np.where(cosine < 0.0, -after, after)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        arc = (np.sin((1.0 - share) * angle) * before + np.sin(share * angle) * after) / sine
    chord = before + share * (after - before)
    return np.where(sine < 1e-6, chord, arc)
